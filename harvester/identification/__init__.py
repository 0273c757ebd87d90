"""Identify a scene from measurements: the fit, its intervals and its verdict."""
