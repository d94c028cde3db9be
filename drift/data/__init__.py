"""Published tables: leeway classes, sweep widths."""
