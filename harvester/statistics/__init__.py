"""Moments of a run, and the estimates, error bars and notes computed from them."""
