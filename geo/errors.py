"""The one kind of error that a user can mend."""


class UserError(Exception):
    """What is wrong, what was given, what is allowed, where to change it: one line, or one a mistake where there are several."""

    def __init__(self, *lines: str) -> None:
        """Take a mistake a line; nothing that stands in one of them may begin another."""
        super().__init__(*lines)

    @property
    def lines(self) -> tuple[str, ...]:
        """The mistakes, a line each."""
        return tuple(" ".join(str(line).split()) for line in self.args)

    def __str__(self) -> str:
        return "\n".join(map(str, self.args))
