"""Preparation of a scene, done once: steps, knots, lines near a resonance, starts."""
