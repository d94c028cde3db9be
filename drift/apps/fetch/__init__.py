"""`drift fetch`: download winds and currents for a box and a span from providers."""
