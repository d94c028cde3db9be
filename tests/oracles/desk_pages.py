"""A page of the desk in a browser, for the tests of its steps."""

import tomllib
from typing import Any

from desks import Server, until

PATIENCE = 180_000  # [ms] on a busy machine
SIZES = {"desktop": {"width": 1600, "height": 1000}, "phone": {"width": 390, "height": 844}}


class Page:
    """A page of the desk, and what the browser complains of."""

    def __init__(self, browser: Any, served: Server, size: str, **options: Any) -> None:
        self.context = browser.new_context(viewport=SIZES[size], **options)
        self.page = self.context.new_page()
        self.complaints: list[str] = []
        self.outside: list[str] = []
        self.page.on("console", self._hear)
        self.page.on("pageerror", lambda error: self.complaints.append(str(error)))
        self.page.on("request", lambda asked: self._see(asked.url, served.host))
        self.page.goto(f"http://{served.host}/?token={served.secret.token}")

    def _hear(self, told: Any) -> None:
        if told.type == "error":
            self.complaints.append(told.text)

    def _see(self, url: str, host: str) -> None:
        if not url.startswith((f"http://{host}/", "data:", "blob:")):
            self.outside.append(url)

    def press(self, name: str, exact: bool = True) -> None:
        self.page.get_by_role("button", name=name, exact=exact).click()

    def fill(self, field: str, value: str) -> None:
        """Type into a field of the search, and wait until the text has it."""
        self.page.locator(f'[data-own="{field}"]').fill(value)
        self.page.keyboard.press("Tab")
        *keys, last = [int(one) if one.isdecimal() else one for one in field.split(".")]

        def has_it() -> bool:
            found = self.tables()
            for key in keys:
                if key not in (found if isinstance(found, dict) else range(len(found))):
                    return False
                found = found[key]
            return str(found.get(last)) == value

        until(has_it, 60)

    def tables(self) -> Any:
        return tomllib.loads(self.page.locator("#text").input_value())
