"""What moves and how: objects, priors, models of motion, their errors, the clock, the run. A step's arithmetic is in kernels."""
