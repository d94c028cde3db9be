"""Clouds of particles that follow one target."""
