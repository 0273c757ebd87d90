"""The shared library, its callbacks, and runs through it."""
