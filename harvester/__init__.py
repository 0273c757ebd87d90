"""Circuit-accurate simulation of vibration energy harvesters under coloured noise."""

__version__ = "0.1.0"
