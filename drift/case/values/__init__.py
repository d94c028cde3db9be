"""Values as a case file writes them: quantities, positions, times, tables of rows."""
