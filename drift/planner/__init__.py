"""What to search next: units and their ways, rectangles, the optimiser, its estimated bound, the plan as crews read it."""
