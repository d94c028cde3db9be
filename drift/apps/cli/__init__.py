"""The command line: what it prints, and how far a run has come."""
