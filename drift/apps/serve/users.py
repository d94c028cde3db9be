"""Users of the desk, and the secrets of a start: tokens, cookies, and keys of results."""

import hashlib
import hmac
import re
import secrets
from collections.abc import Sequence
from dataclasses import dataclass, field

from drift.apps.serve.names import folded
from geo.errors import UserError

LONGEST = 40  # characters of a name
NAME = re.compile(r"\w[\w .-]*")


def _secret() -> str:
    return secrets.token_urlsafe(32)


@dataclass(frozen=True)
class User:
    """A user: the token of the printed address and of API requests, and the cookie for it."""

    name: str = "user"
    guest: bool = False  # may read, not change
    token: str = field(default_factory=_secret)
    cookie: str = field(default_factory=_secret)


@dataclass(frozen=True)
class Secret:
    """The secrets of this start of the server; the first user is the one who started it."""

    users: tuple[User, ...] = field(default_factory=lambda: (User(),))
    runs: str = field(default_factory=_secret)

    @property
    def token(self) -> str:
        """Return the token of the first user."""
        return self.users[0].token

    @property
    def cookie(self) -> str:
        """Return the cookie of the first user."""
        return self.users[0].cookie

    def key(self, run: str) -> str:
        """Return the key for a run's files, which is valid for that run only."""
        return hmac.new(self.runs.encode(), run.encode(), hashlib.sha256).hexdigest()

    def by_token(self, token: str) -> User | None:
        """Return the user of a token; None if there is none."""
        return self._found(token, [user.token for user in self.users])

    def by_cookie(self, cookie: str) -> User | None:
        """Return the user of a cookie; None if there is none."""
        return self._found(cookie, [user.cookie for user in self.users])

    def _found(self, given: str, held: list[str]) -> User | None:
        """Return whose secret was given: in a time that depends on neither."""
        same = [hmac.compare_digest(given.encode(), one.encode()) for one in held]
        return next((user for user, own in zip(self.users, same, strict=True) if own), None)


def users_of(users: Sequence[str], guests: Sequence[str]) -> tuple[User, ...]:
    """Return the users of the names that were given: without any, one; guests come last.

    Raises:
        UserError: a name is not one, or stands twice.
    """
    names = [*users, *guests]
    for option, given in (("--user", users), ("--guest", guests)):
        for name in given:
            if not NAME.fullmatch(name) or len(name) > LONGEST or name != name.strip():
                raise UserError(
                    f'{option} "{name[:100]}": a name has letters, digits, spaces and . _ -, at '
                    f"most {LONGEST}"
                )
            if sum(folded(one) == folded(name) for one in names) > 1:
                raise UserError(
                    f'{option} "{name}": the name is given twice (case does not count); give each '
                    "its own"
                )
    known = tuple(User(name) for name in users) or (User(),)
    return known + tuple(User(name, guest=True) for name in guests)
