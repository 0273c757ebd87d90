"""`simulate`: realizations by one engine, and what they come to."""
