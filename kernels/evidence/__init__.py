"""What sensors reveal about each particle."""
