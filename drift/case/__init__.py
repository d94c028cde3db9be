"""The case file: what is written becomes frozen records in SI units.

Every mistake of a user is refused.
"""
