"""Stiff and extreme cases of a scene, each judged by what has power there."""

# Wall-clock limit of one case by one engine or closure, in seconds.
TIME_LIMIT = 120.0
