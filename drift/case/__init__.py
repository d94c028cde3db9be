"""The case file: what is written becomes frozen records in SI units; every mistake of a user is told here."""
