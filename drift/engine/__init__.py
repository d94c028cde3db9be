"""What moves: particles, their motion, and the environment in which they drift."""
