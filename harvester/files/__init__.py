"""Files read and written, and what of the surroundings is believed."""
