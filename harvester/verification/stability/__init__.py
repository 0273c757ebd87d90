"""Stiff and extreme cases of a scene, each judged: right, refused or wrong."""
