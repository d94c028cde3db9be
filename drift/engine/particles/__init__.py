"""Particle state: columns, statuses, weights, resampling, and sums over the ensemble."""
