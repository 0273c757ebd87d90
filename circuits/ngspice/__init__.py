"""ngspice as a library: its session, callbacks, step control and messages."""
