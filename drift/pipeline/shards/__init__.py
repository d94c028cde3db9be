"""Runs in shards: whole blocks of particles, moved one shard after another, kept, and taken up
again after a fault.
"""
