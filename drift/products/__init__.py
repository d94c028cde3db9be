"""What a run hands out: the drawing kit, report.html, and the one writer of files."""
