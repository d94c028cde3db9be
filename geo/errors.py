"""The one kind of error that a user can mend."""


class UserError(Exception):
    """One line: what is wrong, what was given, what is allowed, where to change it."""
