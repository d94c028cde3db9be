"""The Earth and the files that describe it: sphere, boxes, notation, winds and currents,
shorelines. No particles.
"""
