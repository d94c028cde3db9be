"""The one kind of error that a user can mend."""


class UserError(Exception):
    """A mistake of a user's: what is wrong, what was given, what is allowed, where to change it.

    Each mistake is one line; several are reported together.
    """

    def __init__(self, *lines: str) -> None:
        """Take one line for each mistake; `lines` removes line breaks that stand inside one of them."""
        super().__init__(*lines)

    @property
    def lines(self) -> tuple[str, ...]:
        """The mistakes, one line each."""
        return tuple(" ".join(str(line).split()) for line in self.args)

    def __str__(self) -> str:
        return "\n".join(map(str, self.args))
