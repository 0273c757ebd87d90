"""Optimum of a mean over one parameter or several."""
