"""When the slices of a file are: clocks, means, forecasts in several runs."""
