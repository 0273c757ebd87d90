"""Exports for other tools: netlists, blocks, compiled models, traces; the explorer."""
