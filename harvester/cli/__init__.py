"""The commands of `harvester`, one module each: `add` declares it, `run` carries it out."""
