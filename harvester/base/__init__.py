"""Common to all folders: errors, files, text, worker processes, compilation, registry."""
