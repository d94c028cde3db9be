"""Tracking of one moving target: particle filters, Brownian bridges and real tracks."""
