"""Tracks of what really moved: drifters, ships, animals; which fixes are believed, and means of
what is clustered.
"""
