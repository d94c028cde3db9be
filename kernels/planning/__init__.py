"""Expected results of effort, rectangles, legs, stations and beams, for plans."""
