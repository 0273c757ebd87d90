"""Coexisting motions of a driven device: basins, bifurcations, and residence times in wells."""
