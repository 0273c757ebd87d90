"""What engines and closures return, and how it is written and drawn."""
