"""A target that is rarely seen, held between detections by a cloud of particles that act.

The cloud is cut by every sweep of a sensor, one that found something or not, and filled again:
Borovies 2007, Particle filter based tracking in a detection sparse discrete event simulation
environment, Naval Postgraduate School, hdl.handle.net/10945/3648. What it does to weights is a
heuristic, no Bayes.
"""
