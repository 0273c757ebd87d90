"""Scenes: the input of a simulation, from TOML to the prepared device with its steps and paths."""
