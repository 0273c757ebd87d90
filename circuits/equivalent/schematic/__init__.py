"""Schematics of a scene's circuit."""
