"""Models of motion: drift, and a user's own."""
