"""What drives the area of a forecast: the share of each source of spread, and where models agree."""
