"""Compare loads and values over a grid on common noise: power, optima, ranking."""
