"""From particles to probability: cells, densities, areas, tables and maps."""
