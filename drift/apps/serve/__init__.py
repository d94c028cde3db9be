"""`drift serve`: a local web page (the desk) to write and run cases and to open their reports."""
