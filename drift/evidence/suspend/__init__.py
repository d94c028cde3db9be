"""The basis of a decision to suspend a search, as text and as a picture."""
