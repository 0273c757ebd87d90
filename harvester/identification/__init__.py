"""From measurements to a scene: the fit, its intervals and its verdict."""
