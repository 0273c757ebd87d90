"""The source paper: its figures computed again, and its statements judged."""
