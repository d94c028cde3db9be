"""What moves and how: models of motion, objects, priors, forcing on the device, clock, run."""
