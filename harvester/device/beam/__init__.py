"""Lumped values of a drawing: beams, their bending modes, and magnets at the tip."""
