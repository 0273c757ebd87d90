"""SPICE for vibration energy harvesters: netlists, ngspice and compiled loads."""

# Another project on PyPI has a package "circuits". `harvester` refuses to work with that package.
PROJECT = "vibration-harvester"
