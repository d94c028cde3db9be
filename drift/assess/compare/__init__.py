"""Compare two cases on common random numbers: their differences and standard errors."""
