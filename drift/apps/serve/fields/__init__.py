"""What a form holds: its fields, read from the text of a case and written into it."""
