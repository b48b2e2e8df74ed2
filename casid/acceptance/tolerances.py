"""Tolerance tables of a proof of match: a standard, its tests, and what each of them compares, read from TOML.

A test without the paragraph of its numbers is refused. Numbers are SI and radians once they are read.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import MISSING, dataclass, field, fields
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from casid.acceptance.manoeuvres import MANOEUVRES
from casid.acceptance.quantities import QUANTITIES
from casid.arguments import a_path, given, number, one_of
from casid.errors import InputError, check_known
from casid.records.limits import read_toml
from casid.signals import CHANNELS, label_of, si_factor

CALIBRATED = "calibrated_airspeed"  # m/s, computed from V, density and pressure altitude of flight and simulation
COMPARED = (*(name for name in CHANNELS if name not in ("t", "delta_e", "delta_a", "delta_r", "thrust")), CALIBRATED)
CONFIGURATIONS = ("takeoff", "climb", "cruise", "descent", "approach", "landing")
_FOLDER = Path(__file__).resolve().parent / "standards"
_WORDS = {"calibrated_airspeed": "calibrated airspeed", "az": "normal acceleration", "p": "roll rate"}


@dataclass(frozen=True, kw_only=True)
class Tolerance:
    """One row of a test."""

    channel: str  # what is compared, or what the quantity is measured from
    quantity: str | None = None  # of `QUANTITIES`, where not the time history itself is compared
    reference: str | None = None  # second channel of a quantity that lies between two
    absolute: float | None = None  # limit of simulation minus flight, SI; None: there is none
    relative: float | None = None  # limit as a fraction of flight; with an absolute one, the less restrictive holds
    # "value": of flight at the same sample, or of the quantity; "peak": of the largest size in flight
    relative_to: str = "value"
    unit: str  # in which the row is reported
    # from_s, to_s: span from the beginning of the manoeuvre [s] to which the row is confined
    from_s: float | None = None
    to_s: float | None = None
    either: str | None = None  # rows of a test with the same word are alternatives: one of them suffices

    @property
    def channels(self) -> tuple[str, ...]:
        """Channels that it looks at."""
        return (self.channel,) if self.reference is None else (self.channel, self.reference)

    @property
    def name(self) -> str:
        """Its name among the rows of its test: "theta", "period of beta"."""
        if self.quantity is None:
            return self.channel
        return f"{self.quantity} of {' and '.join(self.channels)}"

    @property
    def words(self) -> str:
        """Name of what is compared: "pitch rate", "period of sideslip angle"."""
        if self.quantity is None:
            return told(self.channel)
        return f"{QUANTITIES[self.quantity].words} of {' and '.join(map(told, self.channels))}"

    @property
    def factor(self) -> float:
        """SI value of one `unit`."""
        return si_factor(self.unit, "")

    def limit(self, flight: Any, peak: float) -> Any:
        """Largest |simulation - flight| that is within tolerance, for a value of flight or an array of them."""
        base = peak if self.relative_to == "peak" else abs(flight)
        relative = (self.relative or 0.0) * base
        return relative if self.absolute is None else np.maximum(self.absolute, relative + 0.0 * abs(flight))

    def __str__(self) -> str:
        parts = [] if self.absolute is None else [_plain(self.absolute / self.factor, self.unit)]
        if self.relative is not None:
            parts.append(f"{100.0 * self.relative:g} %" + (" of the peak" if self.relative_to == "peak" else ""))
        return " or ".join(parts)


@dataclass(frozen=True, kw_only=True)
class Condition:
    """Condition of the flight for a test to apply: the largest size of a channel, SI."""

    channel: str
    peak_from: float
    peak_to: float
    unit: str


@dataclass(frozen=True, kw_only=True)
class StandardTest:
    """A test of a standard: a manoeuvre and what is compared in it."""

    id: str  # id, title: as the standard has them
    title: str
    manoeuvre: str  # of `MANOEUVRES`: by what it is found in a record
    paragraph: str  # that has its numbers
    tolerances: tuple[Tolerance, ...]  # its rows
    condition: Condition | None = None  # what the flight must have been like; None: anything
    configurations: tuple[str, ...] = ()  # of `CONFIGURATIONS`, those in which the test is flown; none: any
    cycles: float = 0.0  # fewest cycles of an oscillation from which it may be judged
    # quantity for which fewer are enough where flight determines it within its tolerance
    cycles_unless: str | None = None
    # before_s, after_s: how long the inputs rest before the manoeuvre, and after it, by the standard
    before_s: float = 0.0
    after_s: float = 0.0
    remark: str = ""  # what the standard states besides

    @property
    def channels(self) -> tuple[str, ...]:
        """Channels that its rows look at."""
        return tuple(dict.fromkeys(name for row in self.tolerances for name in row.channels))


@dataclass(frozen=True, kw_only=True)
class Standard:
    """A tolerance table.

    Attributes
    ----------
    name, edition, source
        Of the standard, and where its text was read.
    tests
        By their id.

    Examples
    --------
    >>> import casid as cs
    >>> cs.Standard.read("part60").name
    '14 CFR Part 60, appendix A, table A2A'
    """

    name: str
    edition: str
    source: str
    tests: Mapping[str, StandardTest] = field(default_factory=dict)

    @classmethod
    def read(cls, tolerances: str | Path) -> Standard:
        """A table that comes with casid by its name, "part60", or one's own TOML file.

        Parameters
        ----------
        tolerances
            ``part60``, or the name of a TOML file.

        Raises
        ------
        InputError
            For a file that cannot be read, an unknown key, channel, quantity or unit, and a test without paragraph.

        Examples
        --------
        >>> import casid as cs
        >>> part60 = cs.Standard.read("part60")
        >>> row = part60.tests["2.c.10"].tolerances[-1]
        >>> row.words, str(row)
        ('normal acceleration', '0.1 g')
        """
        path = a_path(tolerances, "Standard.read")
        known = {file.stem: file for file in sorted(_FOLDER.glob("*.toml"))}
        if path.suffix == "" and not path.exists():
            check_known("tolerance table", (path.name,), known, "Standard.read")
            path = known[path.name]
        try:
            return _standard(read_toml(path))
        except InputError as error:
            raise InputError(f"{path}: {error}" if not str(error).startswith(str(path)) else str(error)) from None


def told(channel: str) -> str:
    """Return the name that a standard gives to a channel."""
    return _WORDS.get(channel, label_of(channel))


def _plain(value: float, unit: str) -> str:
    return f"{float(f'{value:.9g}'):g} {unit}" if unit != "1" else f"{float(f'{value:.9g}'):g}"


def _standard(data: Mapping[str, Any]) -> Standard:
    check_known("key", data, ("standard", "test"), "the table")
    head = _table(data.get("standard"), "[standard]", "name = ..., edition = ..., source = ...")
    tests: dict[str, StandardTest] = {}
    for i, one in enumerate(_rows(data.get("test"), "[[test]]"), 1):
        where = f"test '{one['id']}'" if isinstance(one.get("id"), str) else f"test {i}"
        test = StandardTest(**_values(StandardTest, one, where))
        if test.id in tests:
            raise InputError(f"test {i}: id '{test.id}' stands twice; give each test an id of its own")
        tests[test.id] = test
    return Standard(**_values(Standard, head, "[standard]"), tests=tests)


def _values(kind: type, data: Mapping[str, Any], where: str) -> dict[str, Any]:
    """Fields of a kind as a table of the file has them. Those without a default must be there, but for a unit, which
    follows from what is compared."""
    keys = {_KEYS.get(one.name, one.name): one for one in fields(kind) if one.name in _READERS}
    check_known("key", data, keys, where)
    needed = [key for key, one in keys.items() if one.default is MISSING and one.name != "unit"]
    read = {**dict.fromkeys(needed), **data}
    return {keys[key].name: _READERS[keys[key].name](value, f"{where}: {key}") for key, value in read.items()}


def _configurations(value: Any, what: str) -> tuple[str, ...]:
    if not isinstance(value, list):
        raise InputError(f'{what} is {given(value)}; expected a list like ["approach", "landing"]')
    return tuple(one_of(one, CONFIGURATIONS, what) for one in value)


def _tolerances(value: Any, what: str) -> tuple[Tolerance, ...]:
    return tuple(_tolerance(row, what) for row in _rows(value, what))


def _tolerance(data: Mapping[str, Any], where: str) -> Tolerance:
    where = f"{where} of {data['channel']}" if isinstance(data.get("channel"), str) else where
    own = _values(Tolerance, data, where)
    of_two = "quantity" in own and QUANTITIES[own["quantity"]].of_two
    if of_two != ("reference" in own):
        raise InputError(f"{where}: 'reference' names the second channel of time_between_peaks, and of nothing else")
    if not {"absolute", "relative"} & own.keys():
        raise InputError(f"{where}: neither 'absolute' nor 'relative' is given; give at least one")
    if "absolute" in own and "unit" not in own:
        raise InputError(f"{where}: 'unit' is missing; say in which unit 'absolute' is, like \"deg\"")
    if own.get("from_s", -float("inf")) >= own.get("to_s", float("inf")):
        raise InputError(f"{where}: from_s = {own['from_s']:g} is not before to_s = {own['to_s']:g}")
    return Tolerance(**_in_si(own, ("absolute",), where))


def _condition(data: Any, where: str) -> Condition:
    table = _table(data, where, '{ channel = "q", peak_from = 0.5, peak_to = 2.0, unit = "deg/s" }')
    return Condition(**_in_si(_values(Condition, table, where), ("peak_from", "peak_to"), where))


def _in_si(own: dict[str, Any], names: Sequence[str], where: str) -> dict[str, Any]:
    """The same with these numbers in SI, and a unit: that which is given, which must fit what is compared, or the SI
    unit."""
    channel = own["channel"]
    if "quantity" in own:
        si_unit = QUANTITIES[own["quantity"]].unit
    else:
        si_unit = "m/s" if channel == CALIBRATED else CHANNELS[channel].unit
    like = channel if "quantity" not in own and channel in CHANNELS else {"s": "t", "m/s": "V", "1": "mach"}[si_unit]
    unit = own.get("unit", si_unit)
    si_factor(unit, like, where)
    factor = si_factor(unit, "", where)
    return {**own, "unit": unit, **{name: factor * own[name] for name in names if name in own}}


def _channel(value: Any, what: str) -> str:
    check_known("channel", (_text(value, what),), COMPARED, what)
    return value


def _table(value: Any, where: str, like: str) -> Mapping[str, Any]:
    if not isinstance(value, Mapping):
        raise InputError(f"{where} is {'missing' if value is None else given(value)}; expected {like}")
    return value


def _rows(value: Any, where: str) -> list[Mapping[str, Any]]:
    if not isinstance(value, list) or not value or not all(isinstance(one, Mapping) for one in value):
        raise InputError(f"{where}: no rows; expected at least one [[test]] with at least one [[test.tolerance]]")
    return value


def _text(value: Any, what: str) -> str:
    if not isinstance(value, str) or not value.strip():
        stands = "missing" if value is None else given(value)
        why = "; a number without the paragraph that it stands in is refused" if what.endswith("paragraph") else ""
        raise InputError(f"{what} is {stands}; expected a text{why}")
    return value


_KEYS = {"tolerances": "tolerance"}  # field -> its key in the file, where that is another one
# field -> how its value is read, (value, what it is) -> value
_READERS: Mapping[str, Callable[[Any, str], Any]] = MappingProxyType(
    {
        **dict.fromkeys(("name", "edition", "source", "id", "title", "paragraph", "remark", "unit", "either"), _text),
        **dict.fromkeys(("channel", "reference"), _channel),
        **dict.fromkeys(("quantity", "cycles_unless"), lambda value, what: one_of(value, QUANTITIES, what)),
        **dict.fromkeys(("absolute", "relative"), partial(number, positive=True)),
        **dict.fromkeys(("peak_from", "peak_to", "cycles", "before_s", "after_s"), partial(number, least=0.0)),
        **dict.fromkeys(("from_s", "to_s"), number),
        "relative_to": lambda value, what: one_of(value, ("value", "peak"), what),
        "manoeuvre": lambda value, what: one_of(value, MANOEUVRES, what),
        "configurations": _configurations,
        "condition": _condition,
        "tolerances": _tolerances,
    }
)
