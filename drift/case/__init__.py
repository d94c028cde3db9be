"""The case file: what is written becomes frozen records in SI units, and every mistake of a user is refused."""
