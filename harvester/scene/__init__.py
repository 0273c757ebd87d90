"""Scenes: what is simulated, from TOML to the scaled device."""
