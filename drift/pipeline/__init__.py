"""A run from its case to its files, in one process or many."""
