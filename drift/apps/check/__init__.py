"""`drift check`: how a case is interpreted, and what can be predicted of its run."""
