"""From measured records to a scene: what is free, the fit, its intervals and its proof."""
