"""Score finished runs against the places where their objects were found."""
