"""Spills: worlds, fates of particles, finds, and the number of objects ashore by place and time."""
