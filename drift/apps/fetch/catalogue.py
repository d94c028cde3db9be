"""The catalogue of forcing providers: the user's own entries come before the shipped ones."""

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from datetime import date
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
import platformdirs

from geo.box import Box
from geo.errors import UserError
from geo.forcing.quantity import QUANTITIES
from geo.forcing.times.averages import STAMPS

PROTOCOLS = ("opendap", "erddap", "grib_filter", "copernicusmarine")
NEEDED = ("title", "quantity", "protocol", "variables")
DAY = np.timedelta64(86_400, "s")


@dataclass(frozen=True)
class Provider:
    """One product of a provider: a quantity, its address, and its coverage as far as known.

    address: one, or one for each component. variables: names of the east and north component.
    level: the wanted layer, in the units of its axis. first: dimensions whose first element is
    used. days_back, days_ahead: coverage relative to now. runs: naming of files by run and lead
    time, for forecasts stored that way. stamp: "instant", or which part of an averaging interval
    its time marks ("start", "middle", "end"); "" if the files say it.
    """

    name: str
    title: str
    quantity: str
    protocol: str
    variables: tuple[str, str]
    address: tuple[str, ...] = ()
    dataset: str = ""
    kind: str = ""
    level: float | None = None
    first: tuple[str, ...] = ()
    since: np.datetime64 | None = None
    until: np.datetime64 | None = None
    days_back: float | None = None
    days_ahead: float = 0.0
    resolution: str = ""
    stamp: str = ""
    area: Box | None = None
    license: str = ""
    credentials: str = "none"
    runs: Mapping[str, Any] | None = None

    def span(self, now: np.datetime64) -> tuple[np.datetime64, np.datetime64]:
        """Return the first and the last time that it covers, according to its entry."""
        begin = self.since if self.since is not None else np.datetime64("1900-01-01", "s")
        if self.days_back is not None:
            begin = max(begin, now - self.days_back * DAY)
        return begin, self.until if self.until is not None else now + self.days_ahead * DAY

    def suits(self, box: Box, begin: np.datetime64, end: np.datetime64, now: np.datetime64) -> bool:
        """Return True if it covers a box and a span, according to its entry."""
        first, last = self.span(now)
        return bool(first <= begin and end <= last) and (
            self.area is None or _within(box, self.area)
        )


def _within(box: Box, area: Box) -> bool:
    if not (area.south <= box.south and box.north <= area.north):
        return False
    west = (box.west - area.west) % 360
    return area.east - area.west >= 360 or west + box.east - box.west <= area.east - area.west


def user_file() -> Path:
    """Return where the user's own catalogue is, if there is one."""
    return Path(platformdirs.user_config_dir("casp-drift")) / "providers.toml"


def read_providers(own: Path | None = None) -> dict[str, Provider]:
    """Return all providers by name; the user's entries come first and replace shipped ones.

    own: a catalogue file in place of `providers.toml` in the user's configuration folder.
    """
    shipped = resources.files("drift.data").joinpath("providers.toml").read_text(encoding="utf-8")
    file = own or user_file()
    user_providers: dict[str, Provider] = {}
    if own is not None or file.is_file():
        try:
            user_providers = _parse_catalogue(file.read_text(encoding="utf-8"), str(file))
        except OSError as error:
            raise UserError(f'catalogue "{file}": {error.strerror}') from None
        except UnicodeError:
            raise UserError(f'catalogue "{file}": is not UTF-8 text') from None
    return user_providers | {
        name: one
        for name, one in _parse_catalogue(shipped, "providers.toml").items()
        if name not in user_providers
    }


def _parse_catalogue(text: str, origin: str) -> dict[str, Provider]:
    try:
        tables = tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        raise UserError(f'catalogue "{origin}": not valid TOML: {error}') from None
    errors: list[str] = []
    found: dict[str, Provider] = {}
    for name, table in tables.items():
        try:
            found[name] = _parse_provider(name, table)
        except UserError as error:
            errors.append(f'catalogue "{origin}": [{name}]: {error}')
    if errors:
        raise UserError(*errors)
    return found


def _parse_provider(name: str, table: Any) -> Provider:
    """Return the provider of a catalogue entry; raise UserError for an invalid entry."""
    if not isinstance(table, dict):
        raise UserError("is no table")
    known = {field.name for field in fields(Provider)} - {"name"}
    if unknown := sorted(set(table) - known):
        raise UserError(f'unknown key "{unknown[0]}". Allowed: {", ".join(sorted(known))}')
    if missing := [key for key in NEEDED if key not in table]:
        raise UserError(f"{missing[0]} is missing")
    if not name.replace("_", "").replace("-", "").isalnum() or not name.isascii():
        raise UserError("a name is made of letters, digits, - and _")
    if table["protocol"] not in PROTOCOLS:
        raise UserError(
            f'protocol "{table["protocol"]}" is not known. Allowed: {", ".join(PROTOCOLS)}'
        )
    if table["quantity"] not in QUANTITIES:
        raise UserError(
            f'quantity "{table["quantity"]}" is not known. Allowed: {", ".join(QUANTITIES)}'
        )
    if len(table["variables"]) != 2 or not all(isinstance(one, str) for one in table["variables"]):
        raise UserError("variables must be the names of the east and the north component")
    if table.get("stamp", "") not in ("", *STAMPS):
        raise UserError(f'stamp "{table["stamp"]}" is not known. Allowed: {", ".join(STAMPS)}')
    address = table.get("address", ())
    address = (address,) if isinstance(address, str) else tuple(address)
    if table["protocol"] != "copernicusmarine" and len(address) not in (1, 2):
        raise UserError("address must be one, or one for each component")
    for one in address:
        if not str(one).startswith(("https://", "http://")) or "@" in str(one).split("/")[2]:
            raise UserError(
                "an address begins with https:// or http://, and contains no name or password "
                "(use ~/.netrc)"
            )
    if table["protocol"] in ("erddap", "copernicusmarine") and not table.get("dataset"):
        raise UserError("dataset is missing")
    if table["protocol"] == "grib_filter" and set(table.get("runs", ())) != RUNS:
        raise UserError(f"runs must be {', '.join(sorted(RUNS))}")
    try:
        converted: dict[str, Any] = {"address": address, "variables": tuple(table["variables"])}
        converted |= {"first": tuple(table.get("first", ()))}
        converted |= {key: _time(table[key]) for key in ("since", "until") if key in table}
        converted |= {
            key: float(table[key]) for key in ("level", "days_back", "days_ahead") if key in table
        }
        if "area" in table:
            converted["area"] = Box(**{side: float(edge) for side, edge in table["area"].items()})
        return Provider(name, **{**table, **converted})
    except (TypeError, ValueError) as error:
        raise UserError(f"cannot be read ({error})") from None


RUNS = {"folder", "file", "level", "every", "delay", "steps"}


def _time(value: Any) -> np.datetime64:
    if not isinstance(value, date):  # a datetime of TOML is a date too
        raise UserError(f'"{value}" is no date')
    return np.datetime64(value.isoformat()[:19], "s")


def choose(
    catalogue: Mapping[str, Provider],
    quantities: Sequence[str],
    names: Sequence[str],
    box: Box,
    begin: np.datetime64,
    end: np.datetime64,
    now: np.datetime64,
) -> list[Provider]:
    """Return a provider for each quantity.

    It is the named one, else the first suitable one that needs no credentials.
    """
    chosen: dict[str, Provider] = {}
    for name in names:
        if name not in catalogue:
            raise UserError(
                f"--provider {name}: no such provider. Known: {', '.join(catalogue)}. See: drift fetch --list"
            )
        provider = catalogue[name]
        other = chosen.setdefault(provider.quantity, provider)
        if other.name != name:
            raise UserError(
                f"--provider {name}: {other.name} is named for the {provider.quantity} already; "
                "name one provider for each quantity"
            )
    errors = [
        f"{one.name} has no {' or '.join(quantities)}"
        for one in chosen.values()
        if one.quantity not in quantities
    ]
    for quantity in quantities:
        offers = [one for one in catalogue.values() if one.quantity == quantity]
        suitable = [
            one for one in offers if one.credentials == "none" and one.suits(box, begin, end, now)
        ]
        if quantity not in chosen and not suitable:
            known = ", ".join(one.name for one in offers) or "none"
            errors.append(
                f"{quantity}: no provider without credentials covers this box from {begin}Z to {end}Z; "
                f"name one with --provider ({known})"
            )
        chosen.setdefault(quantity, suitable[0]) if suitable else None
    if errors:
        raise UserError(*errors)
    return [chosen[quantity] for quantity in quantities]
