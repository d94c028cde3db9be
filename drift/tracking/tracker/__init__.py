"""Particle filter of a rarely detected target whose particles act as an adversary would.

Every sweep of a sensor, with or without a detection, removes particles, and the cloud is then
refilled: Borovies 2007, Particle filter based tracking in a detection sparse discrete event
simulation environment, Naval Postgraduate School, hdl.handle.net/10945/3648. Its weights are a
heuristic, not Bayesian.
"""
