"""Compare circuit, Monte Carlo and averaging for one scene."""
