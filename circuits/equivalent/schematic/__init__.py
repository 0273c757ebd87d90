"""The circuit that a scene builds, drawn."""
