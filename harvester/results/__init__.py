"""Results of engines and closures, and how they are written and drawn."""
