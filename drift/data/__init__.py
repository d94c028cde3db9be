"""Published tables: leeway classes, sweep widths, names of places."""
