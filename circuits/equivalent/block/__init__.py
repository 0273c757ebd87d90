"""A scene's device as one block in SI units, for other schematics and system models.

Its pins: `p` and `n`, the floating terminals; `base`, whose voltage against ground is the base's
acceleration, 1 V per m/s²; `x`, whose voltage against ground is the displacement.
"""
