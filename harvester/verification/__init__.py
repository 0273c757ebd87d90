"""Error against run time, stiff and extreme cases, the source paper's figures and statements."""
