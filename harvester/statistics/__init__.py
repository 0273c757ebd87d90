"""Moments of a run, and the estimates, error bars and notes that follow from them."""
