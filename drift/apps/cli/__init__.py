"""The command line: its grammar, the commands, and what they print."""
