"""Many records against one aircraft file: how well each is flown as given, and what changed between the flights."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.stats import norm

from casid.acceptance.theil import fly, theil_of
from casid.errors import EstimationError, InputError
from casid.estimation import Fit, OutputError, Problem, solve
from casid.frames import Rows
from casid.keeping import plain
from casid.model.aircraft import Aircraft
from casid.model.flown_records import default_free, flown_records
from casid.model.numbers import digits, with_deviation
from casid.records.noise import pooled_sigma
from casid.records.record import Record

_CHANCE = 0.01  # that one of all comparisons of a fleet without any change is reported
_MATTERS = 0.1  # of a value: smaller changes are none to an engineer


@dataclass(frozen=True, kw_only=True)
class Change:
    """A value that is another in one flight than in the others."""

    parameter: str
    value: float
    std: float
    others: float
    others_std: float

    @property
    def sigmas(self) -> float:
        """The difference over its standard deviation."""
        return abs(self.value - self.others) / math.hypot(self.std, self.others_std)

    def __str__(self) -> str:
        told = f"{self.parameter} {with_deviation(self.value, self.std)}"
        return f"{told}, others {with_deviation(self.others, self.others_std)}"


@dataclass(frozen=True, kw_only=True)
class FlightRow:
    """One record of a fleet.

    Attributes
    ----------
    record, duration
        Its name, and its length [s].
    errors
        Channel -> r.m.s. error of the simulation as given over the noise of the channel; empty if it diverges.
    diverged
        Where the simulation as given left the numbers; empty if it did not.
    verdict
        Of the estimation from this record alone; or why there is none.
    values
        Parameter -> value and standard deviation from this record alone.
    faults
        Faults of the data, in words.
    changes
        Values that are others than in the other flights, clearest first.
    """

    record: str
    duration: float
    errors: Mapping[str, float]
    diverged: str = ""
    verdict: str = ""
    values: Mapping[str, tuple[float, float]]
    faults: tuple[str, ...] = ()
    changes: tuple[Change, ...] = ()

    @property
    def error(self) -> float:
        """The error of all channels, root mean square; infinite if the simulation diverges."""
        if not self.errors:
            return math.inf
        return math.sqrt(math.fsum(one**2 for one in self.errors.values()) / len(self.errors))

    @property
    def worst(self) -> str:
        """The channel with the largest error; empty if the simulation diverges."""
        return max(self.errors, key=lambda name: self.errors[name], default="")


@dataclass(frozen=True, kw_only=True)
class Fleet:
    """Flights of one aircraft.

    Attributes
    ----------
    aircraft
        Its name.
    flights
        A row for each record, in the order in which they were given.

    Examples
    --------
    After the example of `compare_flights`:

    >>> found = cs.compare_flights(aircraft, flights)  # doctest: +SKIP
    >>> [(row.record, row.error, row.changes) for row in found.flights]  # doctest: +SKIP
    """

    aircraft: str
    flights: tuple[FlightRow, ...]

    @property
    def changed(self) -> bool:
        """Whether a flight differs from the others, has a fault of its data, or cannot be flown."""
        return any(one.changes or one.faults or one.diverged for one in self.flights)

    @property
    def sentence(self) -> str:
        """What changed between the flights."""
        apart = [f"{one.record}: {one.changes[0]}" for one in self.flights if one.changes]
        errors = [one.error for one in self.flights if math.isfinite(one.error)]
        span = f"{digits(min(errors), 2)} to {digits(max(errors), 2)} times the noise" if errors else "no record"
        flown = f"{len(self.flights)} records of {self.aircraft}: as given, off by {span}"
        if not apart:
            return f"{flown}; no value changed between the flights."
        more = f"; and {len(apart) - 3} more" if len(apart) > 3 else ""
        return f"{flown}. What changed between the flights: {'; '.join(apart[:3])}{more}."

    def to_dict(self) -> dict[str, Any]:
        """Return the content of compare.json."""
        rows = [
            plain(one, "record duration error worst errors diverged verdict faults")
            | {"changes": [plain(change, "parameter value std others others_std sigmas") for change in one.changes]}
            | {"values": {name: {"value": v, "std": s} for name, (v, s) in one.values.items()}}
            for one in self.flights
        ]
        return {"schema": "casid.compare/1", **plain(self, "aircraft changed sentence"), "records": plain(rows)}

    def __str__(self) -> str:
        return f"{'changed' if self.changed else 'the same'}: {self.sentence}\n\n{self.rows().text()}"

    def rows(self) -> Rows:
        """A row for each flight: its length, its error as given over the noise, and what differs."""
        rows = []
        for one in self.flights:
            diverges = [f"diverges: {one.diverged}"] if one.diverged else []
            told = "; ".join([*diverges, *one.faults, *map(str, one.changes)])
            rows.append((one.record, one.duration, one.error, one.worst, told or "-"))
        heads = {"record": "", "s": ".1f", "error": ".3g", "worst": "", "what differs": ""}
        return Rows(heads=heads, rows=rows)


def compare_flights(
    aircraft: Aircraft, records: Sequence[Record], faults: Mapping[str, Sequence[str]] | None = None
) -> Fleet:
    """Fly every record by one file, estimate its values from each alone, and find what changed between the flights.

    A value changed if it is further from the mean of the other flights than chance explains, among all values and
    flights, and by more than a tenth.

    Parameters
    ----------
    aircraft
        The file as given; its stated uncertainty is a prior of every estimation.
    records
        At least two flights.
    faults
        Record -> faults of its data in words, as a data check finds them.

    Returns
    -------
    Fleet
        A row for each flight.

    Raises
    ------
    InputError
        For less than two records.

    Examples
    --------
    >>> import casid as cs
    >>> flights = cs.read_records("flight/*.csv")  # doctest: +SKIP
    >>> print(cs.compare_flights(cs.Aircraft.read("plane.toml"), flights))  # doctest: +SKIP
    """
    if len(records) < 2:
        raise InputError(f"compare: {len(records)} record; expected at least two flights of one aircraft")
    noise = _noise(aircraft, records)
    rows = [_row(aircraft, record, noise, tuple((faults or {}).get(record.name, ()))) for record in records]
    count = sum(len(one.values) for one in rows)
    limit = float(norm.isf(0.5 * _CHANCE / max(count, 1)))
    flights = tuple(replace(one, changes=tuple(_changes(one, rows, limit))) for one in rows)
    return Fleet(aircraft=aircraft.name, flights=flights)


def _noise(aircraft: Aircraft, records: Sequence[Record]) -> dict[str, float]:
    """Return the 1-sigma of every channel, as the file states it or as all records show it."""
    names = dict.fromkeys(name for record in records for name in record.channels)
    found = {name: pooled_sigma([one[name] for one in records if name in one]) for name in names}
    return {name: sigma for name, sigma in (found | dict(aircraft.noise)).items() if sigma > 0.0}


def _row(aircraft: Aircraft, record: Record, noise: Mapping[str, float], faults: tuple[str, ...]) -> FlightRow:
    row = FlightRow(record=record.name, duration=record.duration, errors={}, values={}, faults=faults)
    try:
        applied = flown_records(aircraft, [record])
    except InputError as fault:
        return replace(row, diverged=str(fault), verdict="not flown")
    flown = fly(applied, applied.records[0])
    if isinstance(flown, str):
        row = replace(row, diverged=flown)
    else:
        row = replace(row, errors=dict(_errors(applied.model.outputs, record, flown, noise)))
    try:
        problem = Problem(applied.model, applied.records, free=default_free(applied), cost=OutputError(), prior=True)
        fit = solve(problem)
    except (EstimationError, InputError) as fault:
        return replace(row, verdict=str(fault))
    return replace(row, verdict=fit.verdict, values=_estimated(fit))


def _errors(
    outputs: Sequence[str], record: Record, flown: np.ndarray, noise: Mapping[str, float]
) -> Iterator[tuple[str, float]]:
    for i, name in enumerate(outputs):
        if name in record and name in noise and np.isfinite(record[name]).any():
            yield name, theil_of(record[name], flown[:, i]).rms / noise[name]


def _estimated(fit: Fit) -> dict[str, tuple[float, float]]:
    """Return the values that a record determines better than the file; none of a fit that is no solution."""
    if not fit.converged:
        return {}
    told = fit.parameters.items()
    return {name: (e.value, e.std) for name, e in told if 0.0 < e.std < 0.95 * e.prior_std and math.isfinite(e.std)}


def _changes(row: FlightRow, rows: Sequence[FlightRow], limit: float) -> Iterator[Change]:
    """Values of a flight that differ from the weighted mean of the others, clearest first."""
    found = []
    for name, (value, std) in row.values.items():
        others = np.array([one.values[name] for one in rows if one is not row and name in one.values])
        if not len(others):
            continue
        weight = others[:, 1] ** -2.0
        mean = float(np.sum(weight * others[:, 0]) / np.sum(weight))
        spread = float(np.std(others[:, 0], ddof=1)) if len(others) > 2 else 0.0
        others_std = max(float(np.sum(weight)) ** -0.5, spread)
        change = Change(parameter=name, value=value, std=std, others=mean, others_std=others_std)
        if change.sigmas > limit and abs(value - mean) > _MATTERS * abs(mean):
            found.append(change)
    yield from sorted(found, key=lambda one: -one.sigmas)
