"""What a scene is made ready with, once: steps, knots, lines near a resonance, starts."""
