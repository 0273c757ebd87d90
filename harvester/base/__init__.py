"""What every room uses: errors, files, text, worker processes, compilation, registry."""
