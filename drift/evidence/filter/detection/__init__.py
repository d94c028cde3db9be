"""How sensors detect: detection functions, sweep widths, looks, listening."""
