"""Which tolerance of a device matters, how its quantity scatters, and the yield."""
