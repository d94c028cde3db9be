"""How good a forecast is, and what differs between two of them."""
