"""What to search next: units, rectangles, the optimiser, its estimated bound, and the plan as crews read it."""
