"""Coexisting motions of a driven device: basins, bifurcations, and how long wells hold it."""
