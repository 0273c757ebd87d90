"""The equations of a device with a resistor, integrated without ngspice."""
