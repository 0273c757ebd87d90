"""Utilities for all packages: errors, files, text, worker processes, compilation, registry."""
