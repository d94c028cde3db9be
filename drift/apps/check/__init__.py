"""How a case was understood, and what can be known of its run before it is made."""
