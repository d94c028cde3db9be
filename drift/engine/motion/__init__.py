"""What moves and how: objects, priors, models of motion, errors, clock, run.

The arithmetic of a step is in kernels.
"""
