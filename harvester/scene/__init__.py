"""Scenes: what is simulated, from TOML to the prepared device with its steps and paths."""
