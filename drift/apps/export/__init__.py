"""Finished results in the formats of other programs: globes, chart plotters, bridges, geographic
information systems.
"""
