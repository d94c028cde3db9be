"""Tools for every picture: charts, pages, labels.

They contain nothing about any topic: each topic's map.py draws its own layers with them.
"""
