"""Read case files: validate the TOML tables and build frozen records in SI units.

Every user error is rejected, with all errors of a case in one message.
"""
