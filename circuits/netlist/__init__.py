"""A user's netlist: read, checked and expanded into elements and expressions."""
