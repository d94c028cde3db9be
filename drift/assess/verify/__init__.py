"""Real drifters: how forecasts of them did, and which errors suit them."""
