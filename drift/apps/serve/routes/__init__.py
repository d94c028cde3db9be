"""Routes of the desk by topic: what each takes, and which warm process answers it."""
