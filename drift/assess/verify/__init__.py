"""Score forecasts against real drifters, and fit forcing errors to them."""
