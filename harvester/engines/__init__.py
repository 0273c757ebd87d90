"""`simulate` and what it runs: engines, realizations, worker tasks, stored answers."""
