"""The decision to suspend a search: what it rests on, as text and as a picture."""
