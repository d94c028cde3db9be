"""What moves and how: models of motion, objects and their priors, the forcing on the device, the clock, the run."""
