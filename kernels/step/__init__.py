"""One step of what drifts: forcing, errors, shore, life."""
