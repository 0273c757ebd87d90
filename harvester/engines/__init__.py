"""`simulate` and its engines, realizations, worker tasks and stored answers."""
