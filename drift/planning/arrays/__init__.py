"""Planning of sonar arrays: where ships tow them, and which beams to process."""
