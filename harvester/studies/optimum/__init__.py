"""Maximise a mean over one or several parameters."""
