"""`simulate`: realizations by one engine, and the estimates from them."""
