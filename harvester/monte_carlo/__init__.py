"""Monte Carlo reference: the equations themselves on the given noise path."""
