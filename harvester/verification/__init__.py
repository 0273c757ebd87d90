"""Checks of the program against closed forms, other integrators, the source paper and itself."""
