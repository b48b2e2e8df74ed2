"""Tolerance tables of a proof of match: a standard, its tests, and what each of them compares, read from TOML.

A test without the paragraph of its numbers is refused. Numbers are SI and radians once they are read.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
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
    check_known("key", head, ("name", "edition", "source"), "[standard]")
    texts = {key: _text(head, key, "[standard]") for key in ("name", "edition", "source")}
    tests: dict[str, StandardTest] = {}
    for i, one in enumerate(_rows(data.get("test"), "[[test]]"), 1):
        test = _test(one, f"test {i}")
        if test.id in tests:
            raise InputError(f"test {i}: id '{test.id}' stands twice; give each test an id of its own")
        tests[test.id] = test
    return Standard(**texts, tests=tests)


def _test(data: Mapping[str, Any], where: str) -> StandardTest:
    where = f"test '{data['id']}'" if isinstance(data.get("id"), str) else where
    keys = ("id", "title", "manoeuvre", "paragraph", "tolerance", "condition", "remark")
    check_known("key", data, (*keys, "configurations", "cycles", "cycles_unless", "before_s", "after_s"), where)
    texts = {key: _text(data, key, where) for key in ("id", "title", "manoeuvre", "paragraph")}
    one_of(texts["manoeuvre"], MANOEUVRES, f"{where}: manoeuvre")
    condition = data.get("condition")
    unless = data.get("cycles_unless")
    return StandardTest(
        **texts,
        tolerances=tuple(_tolerance(row, f"{where}: tolerance") for row in _rows(data.get("tolerance"), where)),
        configurations=_configurations(data.get("configurations", []), where),
        condition=None if condition is None else _condition(condition, f"{where}: condition"),
        cycles=number(data.get("cycles", 0.0), f"{where}: cycles", least=0.0),
        cycles_unless=None if unless is None else one_of(unless, QUANTITIES, f"{where}: cycles_unless"),
        before_s=number(data.get("before_s", 0.0), f"{where}: before_s", least=0.0),
        after_s=number(data.get("after_s", 0.0), f"{where}: after_s", least=0.0),
        remark=_text(data, "remark", where) if "remark" in data else "",
    )


def _configurations(value: Any, where: str) -> tuple[str, ...]:
    if not isinstance(value, list):
        raise InputError(f'{where}: configurations is {given(value)}; expected a list like ["approach", "landing"]')
    return tuple(one_of(one, CONFIGURATIONS, f"{where}: configurations") for one in value)


def _tolerance(data: Mapping[str, Any], where: str) -> Tolerance:
    keys = ("channel", "quantity", "reference", "absolute", "relative", "relative_to", "unit", "from_s", "to_s")
    check_known("key", data, (*keys, "either"), where)
    channel = _compared(data, "channel", where)
    where = f"{where} of {channel}"
    quantity = one_of(data["quantity"], QUANTITIES, f"{where}: quantity") if "quantity" in data else None
    of_two = quantity is not None and QUANTITIES[quantity].of_two
    if of_two != ("reference" in data):
        raise InputError(f"{where}: 'reference' names the second channel of time_between_peaks, and of nothing else")
    given_limits = [key for key in ("absolute", "relative") if key in data]
    if not given_limits:
        raise InputError(f"{where}: neither 'absolute' nor 'relative' is given; give at least one")
    if "absolute" in data and "unit" not in data:
        raise InputError(f"{where}: 'unit' is missing; say in which unit 'absolute' is, like \"deg\"")
    unit = _unit(data, channel, quantity, where)
    limits = {key: number(data[key], f"{where}: {key}", positive=True) for key in given_limits}
    if "absolute" in limits:
        limits["absolute"] *= si_factor(unit, "", where)
    span = {key: number(data[key], f"{where}: {key}") for key in ("from_s", "to_s") if key in data}
    if span.get("from_s", -float("inf")) >= span.get("to_s", float("inf")):
        raise InputError(f"{where}: from_s = {span['from_s']:g} is not before to_s = {span['to_s']:g}")
    return Tolerance(
        channel=channel,
        quantity=quantity,
        reference=_compared(data, "reference", where) if of_two else None,
        relative_to=one_of(data.get("relative_to", "value"), ("value", "peak"), f"{where}: relative_to"),
        unit=unit,
        either=_text(data, "either", where) if "either" in data else None,
        **limits,
        **span,
    )


def _unit(data: Mapping[str, Any], channel: str, quantity: str | None, where: str) -> str:
    """The unit of a row, which must fit what is compared; without one, its SI unit."""
    expected = _si_unit(channel) if quantity is None else QUANTITIES[quantity].unit
    if "unit" not in data:
        return expected
    unit = _text(data, "unit", where)
    like = channel if quantity is None and channel in CHANNELS else {"s": "t", "m/s": "V", "1": "mach"}[expected]
    si_factor(unit, like, where)
    return unit


def _si_unit(channel: str) -> str:
    return "m/s" if channel == CALIBRATED else CHANNELS[channel].unit


def _condition(data: Any, where: str) -> Condition:
    table = _table(data, where, '{ channel = "q", peak_from = 0.5, peak_to = 2.0, unit = "deg/s" }')
    check_known("key", table, ("channel", "peak_from", "peak_to", "unit"), where)
    channel = _compared(table, "channel", where)
    unit = _unit(table, channel, None, where)
    low, high = (number(table.get(key), f"{where}: {key}", least=0.0) for key in ("peak_from", "peak_to"))
    factor = si_factor(unit, "", where)
    return Condition(channel=channel, peak_from=low * factor, peak_to=high * factor, unit=unit)


def _compared(data: Mapping[str, Any], key: str, where: str) -> str:
    name = _text(data, key, where)
    check_known("channel", (name,), COMPARED, where)
    return name


def _table(value: Any, where: str, like: str) -> Mapping[str, Any]:
    if not isinstance(value, Mapping):
        raise InputError(f"{where} is {'missing' if value is None else given(value)}; expected {like}")
    return value


def _rows(value: Any, where: str) -> list[Mapping[str, Any]]:
    if not isinstance(value, list) or not value or not all(isinstance(one, Mapping) for one in value):
        raise InputError(f"{where}: no rows; expected at least one [[test]] with at least one [[test.tolerance]]")
    return value


def _text(data: Mapping[str, Any], key: str, where: str) -> str:
    value = data.get(key)
    if not isinstance(value, str) or not value.strip():
        stands = "missing" if value is None else given(value)
        why = "; a number without the paragraph that it stands in is refused" if key == "paragraph" else ""
        raise InputError(f"{where}: '{key}' is {stands}; expected a text{why}")
    return value
