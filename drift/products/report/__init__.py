"""report.html: one file for each run, with a map over time; it contains nothing about any topic."""
