"""Writes a prepared scene as a netlist, a block, Verilog-A or a schematic."""
