"""Runs in shards: parts of the particles, simulated one after another and stored, so that a stopped
run can resume.
"""
