"""Engines: Monte Carlo and the circuit behind one protocol, steps, worker processes."""
