"""A load's netlist compiled: element tables of it, and one solver for all of them with the device."""
