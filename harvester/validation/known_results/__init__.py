"""`verify`: exact and published results beside what this project computes."""
