"""drift: forecasts and search plans for things adrift at sea."""
