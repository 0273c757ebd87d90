"""Every method's error against the time it takes: one measurement, and two pictures of it."""
