"""`python -m drift` is the command line `drift`."""

from drift.apps.cli import commands

if __name__ == "__main__":
    commands.leave()
