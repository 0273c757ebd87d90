"""A load's netlist compiled: its element tables and one solver for all of them."""
