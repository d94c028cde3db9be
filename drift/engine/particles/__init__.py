"""The particles: their columns and lives, their weights, and sums over all of them."""
