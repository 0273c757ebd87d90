"""A device for people's own tools: netlists, blocks, compiled models, traces."""
