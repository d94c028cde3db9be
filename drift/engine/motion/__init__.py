"""Motion of particles: objects, priors, motion models, forcing errors, the clock and the run.

The arithmetic of a step is in kernels.
"""
