"""Field types of the case file: pydantic annotations that check a value and convert it to SI.

An error message says what was given and what is allowed; messages.py adds the place in the file.
"""

import difflib
import re
from collections.abc import Callable, Mapping, Sequence
from datetime import datetime
from typing import Annotated, Any, ClassVar, get_args, get_origin

import numpy as np
from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    ModelWrapValidatorHandler,
    ValidationError,
    ValidationInfo,
    model_validator,
)
from pydantic_core import InitErrorDetails

from drift.case.values import units

# a direction with its reference: true (T) or magnetic (M) north
NORTH = re.compile(r"([\d.]+)\s*°?\s*([TM])(?:RUE|AG\.?|AGNETIC)?", re.IGNORECASE)

MOST_UNKNOWN = 20  # unknown keys of a table that are named, each compared with all known ones

# 16 points of the compass, clockwise from north
COMPASS = "N NNE NE ENE E ESE SE SSE S SSW SW WSW W WNW NW NNW"


class Table(BaseModel):
    """A table of the case file: frozen, without unknown keys."""

    # former names of keys, still accepted, and the present names
    old_keys: ClassVar[Mapping[str, str]] = {}

    model_config = ConfigDict(
        extra="forbid", frozen=True, arbitrary_types_allowed=True, populate_by_name=False
    )

    @model_validator(mode="wrap")
    @classmethod
    def known_keys(
        cls, data: Any, handler: ModelWrapValidatorHandler[Any], info: ValidationInfo
    ) -> Any:
        """Reject unknown keys with a suggestion, together with the other mistakes of the table.

        If the key belongs to a table inside this one or to the whole file (validation context
        "whole"), the message names that table instead.

        Mistakes that an unknown key causes are not reported: that the key it stands for is missing,
        and errors of the table as a whole. A former name of a key is accepted unless the present
        name is given too.
        """
        if isinstance(data, cls):
            return handler(data)
        if not isinstance(data, dict):
            raise ValueError(f"must be a table, not {data!r}")
        known = [field.alias or name for name, field in cls.model_fields.items()]
        twice = {old: new for old, new in cls.old_keys.items() if old in data and new in data}
        data = {
            cls.old_keys.get(key, key): value for key, value in data.items() if key not in twice
        }
        strange = [str(key) for key in data if str(key) not in known]
        listed, more = strange[:MOST_UNKNOWN], len(strange) - MOST_UNKNOWN
        unknown = {key: difflib.get_close_matches(key, known, n=1, cutoff=0.6) for key in listed}
        if not unknown and not twice:
            return handler(data)
        wrong = [
            f'"{old}" is the old name of "{new}", and both are given; give {new} alone'
            for old, new in twice.items()
        ]
        whole = (info.context or {}).get("whole", cls)
        places = {key: _tables_with(cls, key) for key in unknown}
        places |= {
            key: ["the file itself, above its first [table]"]
            for key in unknown
            if key in whole.model_fields
        }
        unknown = {key: [] if places[key] else near for key, near in unknown.items()}
        hints = {
            key: f'did you mean "{near[0]}"? ' if near else "" for key, near in unknown.items()
        }
        hints |= {
            key: f"it is a key of {' and '.join(tables)}. "
            for key, tables in places.items()
            if tables
        }
        wrong += [
            f'unknown key "{key}"; {hint}{"A" if hint else "a"}llowed: {", ".join(known)}'
            for key, hint in hints.items()
        ]
        wrong += [f"and {more:,} more unknown keys"] if more > 0 else []
        meant = {near[0] for near in unknown.values() if near}
        other: list[InitErrorDetails] = []
        try:
            handler({key: value for key, value in data.items() if key in known})
        except ValidationError as error:
            other = [
                _detail(mistake)
                for mistake in error.errors(include_url=False)
                if mistake["loc"]
                and not (mistake["type"] == "missing" and mistake["loc"][0] in meant)
            ]
        raise ValidationError.from_exception_data(cls.__name__, [*map(complaint, wrong), *other])


def _tables_with(table: type[Table], key: str) -> list[str]:
    """Return the tables inside a table that have a key, in the notation of the case file."""
    found = []
    for name, field in table.model_fields.items():
        kinds = _kinds(field.annotation)
        several = any(
            get_origin(kind) is list for kind in (field.annotation, *get_args(field.annotation))
        )
        if any(
            key in [inner.alias or own for own, inner in kind.model_fields.items()]
            for kind in kinds
        ):
            found.append(f"[[{field.alias or name}]]" if several else f"[{field.alias or name}]")
    return found


def _kinds(annotation: Any) -> list[type[Table]]:
    """Return the table classes in a type annotation."""
    if isinstance(annotation, type) and issubclass(annotation, Table):
        return [annotation]
    return [kind for inner in get_args(annotation) for kind in _kinds(inner)]


def complaint(message: str) -> InitErrorDetails:
    """Return an error detail about a whole table, to be raised together with others."""
    return {"type": "value_error", "loc": (), "input": None, "ctx": {"error": ValueError(message)}}


def refuse(table: BaseModel, messages: Sequence[str]) -> None:
    """Raise one ValidationError with all messages about a table, if there are any."""
    if messages:
        raise ValidationError.from_exception_data(
            type(table).__name__, [complaint(message) for message in messages]
        )


def _detail(mistake: Any) -> InitErrorDetails:
    return {
        "type": mistake["type"],
        "loc": mistake["loc"],
        "input": mistake["input"],
        "ctx": mistake.get("ctx", {}),
    }


def one_of(table: BaseModel, names: tuple[str, ...]) -> str:
    """Return the one of the named keys that is given; raise ValueError for none or several."""
    given = [name for name in names if getattr(table, name) is not None]
    if len(given) != 1:
        found = " and ".join(given) if given else "none"
        raise ValueError(f"exactly one of {', '.join(names)} must be given; found {found}")
    return given[0]


def _percent(value: object, unit: str, high: float) -> str:
    """Return how to write a share that was given as a number of per cent; "" for all else."""
    meant = not unit and high <= 1 and isinstance(value, int | float) and value <= 100 * high
    return f'; write {value:g} per cent as "{value:g} %"' if meant else ""


def _quantity(
    unit: str,
    what: str,
    example: str,
    low: float = 0.0,
    high: float = float("inf"),
    above: bool = False,
) -> BeforeValidator:
    """Return a validator of a quantity in [low, high], or in (low, high] if `above` is set."""

    def check(value: object) -> float:
        number = units.quantity(value, unit, what, example)
        if number < low or (above and number == low):
            raise ValueError(
                f"{what} {value!r} must be {'above' if above else 'at least'} {low:g} {unit}".rstrip()
            )
        if number > high:
            raise ValueError(
                f"{what} {value!r} must be at most {high:g} {unit}".rstrip()
                + _percent(value, unit, high)
            )
        return number

    return BeforeValidator(check)


def pair_of(single: Callable[[object], float]) -> Callable[[object], tuple[float, float]]:
    """Return a validator that accepts [low, high], or one value for both."""

    def check(value: object) -> tuple[float, float]:
        if not isinstance(value, list | tuple):
            return single(value), single(value)
        if len(value) != 2:
            raise ValueError(f"{list(value)!r} must be one value or [low, high]")
        return single(value[0]), single(value[1])

    return check


def _ordered(single: Callable[[object], float]) -> BeforeValidator:
    def check(value: object) -> tuple[float, float]:
        low, high = pair_of(single)(value)
        if high < low:
            raise ValueError(f"{value!r} must go from low to high")
        return low, high

    return BeforeValidator(check)


def direction(value: object) -> float:
    if isinstance(value, str) and (said := NORTH.fullmatch(value.strip())):
        if said[2].upper() == "M":
            raise ValueError(f'"{value}" is magnetic; directions are true: add the variation')
        value = said[1]
    points = COMPASS.split()
    if isinstance(value, str) and value.strip().upper() in points:
        degrees = 22.5 * points.index(value.strip().upper())
        raise ValueError(f'"{value}" is not a direction in degrees; write {degrees:g}')
    degrees = units.quantity(value, "deg", "direction", "120 deg")
    if not 0 <= degrees <= 360:
        raise ValueError(f"direction {value!r} must be 0 to 360 degrees clockwise from true north")
    return degrees


def _sector(value: object) -> tuple[float, float]:
    """Return a sector [deg] clockwise from its first to its second edge: [350, 20] spans 30 deg."""
    first, second = pair_of(direction)(value)
    return first, second if second >= first else second + 360.0


def count(value: object) -> int:
    if isinstance(value, bool) or not isinstance(value, int | float) or value % 1 != 0:
        raise ValueError(f"{value!r} is not a whole number")
    if abs(value) > 2**64:
        raise ValueError(f"{str(value)[:20]}... is too large a number")
    return int(value)


def _jibe(value: object) -> float:
    # bare numbers are per hour, as in the literature
    rate = value / 3600.0 if isinstance(value, int | float) else value
    number = units.quantity(rate, "1/s", "jibing rate", "0.04 / h")
    if not 0 <= number <= 1 / 60:
        raise ValueError(f"jibing rate {value!r} must be 0 to 60 per hour")
    return number


def rate(value: object) -> float:
    """Return a rate of events [1/s]; a unit is required, as a bare number could mean any."""
    if value != 0 and (not isinstance(value, str) or not any(letter.isalpha() for letter in value)):
        raise ValueError(f'rate {value!r} needs a unit, like "{value} /h"')
    number = units.quantity(value, "1/s", "rate", "0.2 /day")
    if not 0 <= number <= 1:
        raise ValueError(f"rate {value!r} must be 0 to 1 per second")
    return number


def share(value: object) -> float:
    number = units.quantity(value, "", "share", "0.2")
    if not 0 <= number <= 1:
        raise ValueError(f"{value!r} must be a share, 0 to 1")
    return number


# limits of weights: their products and sums stay within the range of floats
LIGHTEST, HEAVIEST = 1e-30, 1e30


def _weight(value: object) -> float:
    """Return a weight: 0, or LIGHTEST to HEAVIEST; only the ratios of weights matter."""
    number = units.quantity(value, "", "weight", "0.5")
    if number < 0:
        raise ValueError(f"weight {value!r} must be at least 0")
    if number != 0 and not LIGHTEST <= number <= HEAVIEST:
        raise ValueError(
            f"weight {value!r} must be 0, or {LIGHTEST:g} to {HEAVIEST:g}: only ratios of weights matter, so divide all by the same number"
        )
    return number + 0.0


HALF_TURN = 2.0015e7  # [m] half the Earth's circumference, the largest length in a case

_length = _quantity("m", "distance", "5 nmi", high=HALF_TURN)
_area = _quantity("m^2", "area", "120 nmi2")

Length = Annotated[float, _length]
Width = Annotated[float, _quantity("m", "width", "5 nmi", above=True, high=2_000_000)]
Reach = Annotated[float, _quantity("m", "distance", "5 nmi", above=True, high=2_000_000)]
Depth = Annotated[float, _quantity("m", "depth", "0 m", high=12_000)]
Speed = Annotated[float, _quantity("m/s", "speed", "12 kn", high=150)]
WindSpeed = Annotated[float, _quantity("m/s", "wind", "12 kn", high=90)]
CurrentError = Annotated[float, _quantity("m/s", "error of a current", "0.1 m/s", high=2.5)]
WindError = Annotated[float, _quantity("m/s", "error of a wind", "1.5 m/s", high=20)]
SignedSpeed = Annotated[float, _quantity("m/s", "speed", "2 cm/s", low=-150, high=150)]
_ship_speed = _quantity("m/s", "speed", "8 kn", above=True, high=150)
ShipSpeed = Annotated[float, _ship_speed]
SHORTEST = 1e-3  # [s] shortest duration; less is a typing error
_any_duration = _quantity("s", "duration", "48 h", above=True, high=units.CENTURY)


def _long_enough(value: object) -> float:
    number = float(_any_duration.func(value))  # type: ignore[call-arg]
    if number < SHORTEST:
        raise ValueError(f"duration {value!r} must be at least {SHORTEST:g} s")
    return number


_duration = BeforeValidator(_long_enough)
Duration = Annotated[float, _duration]
Diffusivity = Annotated[float, _quantity("m^2/s", "diffusivity", "10 m2/s", high=1e4)]
SpreadRate = Annotated[float, BeforeValidator(units.spread_rate)]  # [m/sqrt(s)]
Timeout = Annotated[float, _quantity("s", "timeout", "60 s", low=1, high=3600)]
Slope = Annotated[float, _quantity("", "share of the wind speed", "3 %", low=-0.5, high=0.5)]
Windage = Annotated[float, _quantity("", "share of the wind speed", "3 %", high=0.5)]
Weight = Annotated[float, BeforeValidator(_weight)]
Share = Annotated[float, BeforeValidator(share)]


MOST_LETTERS = 1000  # of a name or title


def _label(value: object) -> object:
    if isinstance(value, str) and len(value) > MOST_LETTERS:
        raise ValueError(f"{value[:20]!r}... has {len(value):,} letters; at most {MOST_LETTERS:,}")
    if isinstance(value, str) and (not value.strip() or not value.isprintable()):
        raise ValueError(f"{value!r} must be one line of letters")
    return value


def _percents(value: object) -> tuple[float, ...]:
    """Convert percentages, each at least 1 and below 100, to shares."""
    if not isinstance(value, list) or not value:
        raise ValueError(f"{value!r} must be a list of percentages like [50, 90]")
    shares = []
    for one in value:
        if isinstance(one, bool) or not isinstance(one, int | float) or not 0 < one < 100:
            raise ValueError(f"{one!r} must be a percentage above 0 and below 100")
        if one < 1:
            raise ValueError(
                f"{one!r} is less than 1 per cent; write {100 * one:g} for a share of {one:g}"
            )
        shares.append(float(one) / 100)
    return tuple(sorted(set(shares)))


Percents = Annotated[tuple[float, ...], BeforeValidator(_percents)]  # as shares, ascending
# a title or name for maps and tables
Label = Annotated[str, BeforeValidator(_label)]
Count = Annotated[int, BeforeValidator(count)]
Rate = Annotated[float, BeforeValidator(_jibe)]
Direction = Annotated[float, BeforeValidator(direction)]
Sector = Annotated[tuple[float, float], BeforeValidator(_sector)]
LengthRange = Annotated[tuple[float, float], _ordered(_length.func)]
AreaRange = Annotated[tuple[float, float], _ordered(_area.func)]
ship_speed = _ship_speed.func  # validators as functions, for values.spreads
interval: Callable[[object], Any] = _quantity("s", "time after", "2 h", high=units.CENTURY).func  # type: ignore[assignment]


def _moment(value: object) -> float | units.Instant:
    if isinstance(value, datetime) or (
        isinstance(value, str) and re.match(r"\s*(\d{4}-\d|\d{6}\s*[A-Za-z])", value)
    ):
        return units.time(value)
    return float(interval(value))


DurationRange = Annotated[tuple[float, float], _ordered(_duration.func)]
ShareRange = Annotated[tuple[float, float], _ordered(share)]
LengthPair = Annotated[tuple[float, float], BeforeValidator(pair_of(_length.func))]
Position = Annotated[tuple[float, float], BeforeValidator(units.position)]  # (lon, lat) [deg]
Longitude = Annotated[float, BeforeValidator(lambda value: units.angle(value, "EW"))]
# longitude of an edge of a box, which may be above 180
Edge = Annotated[float, BeforeValidator(units.edge)]
Latitude = Annotated[float, BeforeValidator(lambda value: units.angle(value, "NS"))]
Time = Annotated[units.Instant, BeforeValidator(units.time)]
# after the start [s], or a date and time
Moment = Annotated[float | units.Instant, BeforeValidator(_moment)]


def seconds(moment: float | units.Instant, start: np.datetime64) -> float:
    """Return a Moment as time after the start [s]."""
    if isinstance(moment, float):
        return moment
    return float((units.resolve(moment, start) - start) / np.timedelta64(1, "s"))
