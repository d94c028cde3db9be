"""`drift sensor`: maps, tables and summaries of where a sensor of a case would detect a target."""
