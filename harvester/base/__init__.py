"""What every other folder uses: errors, files, text, worker processes, compilation, registry."""
