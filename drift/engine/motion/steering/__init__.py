"""Steering: targets that follow an itinerary before they go adrift, and lane networks."""
