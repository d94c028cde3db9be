"""report.html: one file for each run, with a map that moves through time; it knows no topic."""
