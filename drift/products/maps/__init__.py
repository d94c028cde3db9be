"""The drawing kit of every map.py: charts, pages and labels.

It knows no topic: each map.py says what stands where.
"""
