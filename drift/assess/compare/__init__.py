"""Two cases on common random numbers: what differs, and how sure that is."""
