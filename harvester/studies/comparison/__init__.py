"""One scene by circuit, Monte Carlo and averaging, side by side."""
