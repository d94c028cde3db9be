"""Search evidence: sorties, contacts and sensors, and the particle filter that applies them."""
