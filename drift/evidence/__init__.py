"""What searches, contacts and sensors reveal about the particles."""
