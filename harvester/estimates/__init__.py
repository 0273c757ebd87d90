"""Means with error bars, densities, balances and notes from the moments of a run."""
