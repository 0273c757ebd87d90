"""Means and densities of a scene without noise paths: averaging, Fokker–Planck, spectral."""
