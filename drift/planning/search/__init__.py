"""What to search next: units, rectangles, the optimiser and its bound, and the plan as crews read
it.
"""
