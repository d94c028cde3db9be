"""Commands: one package for each command that is not a run."""
