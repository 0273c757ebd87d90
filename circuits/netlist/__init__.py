"""A load's netlist: read, counted, vetted, put together."""
