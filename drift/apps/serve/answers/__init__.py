"""What the warm processes answer."""
