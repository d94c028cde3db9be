"""Taichi: started once, arrays moved, launches bound, cards found."""
