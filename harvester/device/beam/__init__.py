"""From a drawing to lumped values: beams, the modes of their sections, and magnets at the tip."""
