"""Loads and values over a grid on the same noise: power, optima, ranking."""
