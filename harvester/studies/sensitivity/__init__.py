"""Tolerance study: effect of each tolerance on a quantity, its scatter, and the yield."""
