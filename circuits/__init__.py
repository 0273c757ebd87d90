"""SPICE for vibration energy harvesters: netlists, ngspice and compiled loads."""

# Another project on PyPI has a package of this name. `harvester` refuses to work with it.
PROJECT = "vibration-harvester"
