"""Plans of the next search: units, search areas, optimiser, upper bound and output files."""
