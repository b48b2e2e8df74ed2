"""Flight against simulation by the rows of a test: deviation, limit, time out of tolerance, pass or fail.

And a test in one record: what flight and the simulations give, and what parts of the extended aircraft cost.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from casid.acceptance.conditions import Condition
from casid.acceptance.flown import Flown, calibrated_airspeed
from casid.acceptance.manoeuvres import Window
from casid.acceptance.quantities import QUANTITIES, UNKNOWN, Oscillation, Quantity, oscillation
from casid.acceptance.smoothing import Smooth, smooth
from casid.acceptance.tolerances import CALIBRATED, StandardTest, Tolerance
from casid.model.dynamics import standard_density
from casid.model.numbers import digits
from casid.records.record import Record

GIVEN = "as given"
EXTENDED = "extended"
VERDICTS = {True: "pass", False: "fail", None: "not judged"}
_WORST_FIRST = (False, None, True)
_ROUNDING = 1e-9  # of a limit: at the limit is within


@dataclass(frozen=True, eq=False, kw_only=True)
class Flight:
    """The measured side of a test."""

    t: np.ndarray  # (N,) clock of the record [s]
    samples: Mapping[str, np.ndarray]  # channel -> (N,) as measured
    curves: Mapping[str, np.ndarray]  # channel -> (N,) with its noise smoothed: what is compared
    noise: Mapping[str, float]  # channel -> 1-sigma that was taken off
    quantities: Mapping[Tolerance, Quantity]  # row of the test -> derived quantity


@dataclass(frozen=True, kw_only=True)
class Check:
    """One row of a test, judged."""

    tolerance: Tolerance  # the row
    passed: bool | None  # within tolerance; None: not judged, `why` has the reason
    used: float = math.nan  # largest part of the tolerance that is used, 1 at the limit
    # deviation, limit: simulation minus flight, and the tolerance, where most of it is used
    deviation: float = math.nan
    limit: float = math.nan
    at_s: float = math.nan  # when that is, on the clock of the record; of a time history
    in_s: float = math.nan  # in_s, out_s: time in and out of tolerance [s]; of a time history
    out_s: float = math.nan
    flight: Quantity | None = None  # flight, simulation: of a derived quantity
    simulation: Quantity | None = None
    why: str = ""


def smoothed_channels(record: Record, names: Sequence[str]) -> dict[str, Smooth]:
    """Channels that a record measures, over its whole length."""
    there = _compared(record.channels, record, names)
    return {n: smooth(record.t, values) for n, values in there.items() if np.isfinite(values).any()}


def flight_of(test: StandardTest, record: Record, smoothed: Mapping[str, Smooth], window: Window) -> Flight:
    """Return the part of a record, whose channels are `smoothed`, that a test compares."""
    inside = (record.t >= window.start) & (record.t <= window.end)
    part = window.part_of(record)
    samples = _compared(part.channels, part, [name for name in test.channels if name in smoothed])
    return Flight(
        t=part.t,
        samples=samples,
        curves={name: smoothed[name].curve[inside] for name in samples},
        noise={name: smoothed[name].sigma for name in samples},
        quantities=_quantities(test, part.t, samples, window),
    )


def _compared(channels: Mapping[str, np.ndarray], record: Record, names: Sequence[str]) -> dict[str, np.ndarray]:
    """Those of the channels that are there, the calibrated airspeed computed; density and altitude are those of flight
    for both sides."""
    found = {name: values for name, values in channels.items() if name != CALIBRATED}
    if CALIBRATED in names and "V" in channels:
        altitude = smooth(record.t, record["altitude"]).curve if "altitude" in record else None
        rho = record["rho"] if "rho" in record else None if altitude is None else standard_density(altitude)
        if rho is not None:
            found[CALIBRATED] = calibrated_airspeed(channels["V"], rho, altitude)
    return {name: found[name] for name in names if name in found}


def _quantities(
    test: StandardTest, t: np.ndarray, y: Mapping[str, np.ndarray], window: Window
) -> dict[Tolerance, Quantity]:
    """Row -> its quantity; one oscillation is fitted for all rows that look at the same channels and span."""
    fitted: dict[tuple, Oscillation | None] = {}
    found = {}
    for row in test.tolerances:
        if row.quantity is None:
            continue
        if any(name not in y for name in row.channels):
            found[row] = UNKNOWN
            continue
        inside = span(row, t, window)
        kind = QUANTITIES[row.quantity]
        if kind.of_response is not None:
            found[row] = kind.of_response(t[inside], y[row.channel][inside])
            continue
        key = (*row.channels, row.from_s, row.to_s)
        if key not in fitted:
            fitted[key] = oscillation(t[inside], [y[name][inside] for name in row.channels])
        one = fitted[key]
        found[row] = UNKNOWN if one is None or kind.of_oscillation is None else kind.of_oscillation(one)
    return found


def span(row: Tolerance, t: np.ndarray, window: Window) -> np.ndarray:
    """(N,) where a row applies."""
    low = -math.inf if row.from_s is None else window.begin + row.from_s
    high = math.inf if row.to_s is None else window.begin + row.to_s
    return (t >= low - _ROUNDING) & (t <= high + _ROUNDING)


def compared_channels(flown: Flown, record: Record, window: Window, names: Sequence[str]) -> dict[str, np.ndarray]:
    """Channels of a simulation as they are compared with flight; without those that it does not give."""
    return _compared(flown.channels, window.part_of(record), names)


def checks_of(test: StandardTest, record: Record, window: Window, flight: Flight, flown: Flown) -> tuple[Check, ...]:
    """Every row of a test, in their order."""
    if flown.diverged:
        return tuple(Check(tolerance=row, passed=False, used=math.inf, why=flown.diverged) for row in test.tolerances)
    there = compared_channels(flown, record, window, test.channels)
    measured = _quantities(test, flight.t, there, window)
    return tuple(_check(row, test, window, flight, there, measured) for row in test.tolerances)


def _check(
    row: Tolerance,
    test: StandardTest,
    window: Window,
    flight: Flight,
    simulated: Mapping[str, np.ndarray],
    measured: Mapping[Tolerance, Quantity],
) -> Check:
    for name in row.channels:
        if name not in flight.curves:
            return Check(tolerance=row, passed=None, why=f"{name} is not measured")
        if name not in simulated:
            return Check(tolerance=row, passed=None, why=f"the simulation has no {name}")
    if row.to_s is not None and window.begin + row.to_s > flight.t[-1] + np.median(np.diff(flight.t)):
        lasts = flight.t[-1] - window.begin
        return Check(tolerance=row, passed=None, why=f"the manoeuvre lasts {lasts:.1f} s, the row {row.to_s:g} s")
    if row.quantity is not None:
        enough = _fewer_are_enough(test, flight.quantities)
        return _quantity_check(row, test, flight.quantities[row], measured[row], enough)
    return _history_check(row, window, flight, simulated[row.channel])


def _history_check(row: Tolerance, window: Window, flight: Flight, simulated: np.ndarray) -> Check:
    """Within tolerance at every sample."""
    inside = span(row, flight.t, window) & np.isfinite(flight.samples[row.channel])
    if inside.sum() < 2:
        return Check(tolerance=row, passed=None, why="no samples lie in its span")
    t = flight.t[inside]
    curve = flight.curves[row.channel][inside]
    deviation = simulated[inside] - curve
    limit = row.limit(curve, float(np.abs(curve).max()))
    used = np.abs(deviation) / np.maximum(limit, 1e-300)
    out = used > 1.0 + _ROUNDING
    step = np.gradient(t)
    worst = int(np.argmax(used))
    return Check(
        tolerance=row,
        passed=not out.any(),
        used=float(used[worst]),
        deviation=float(deviation[worst]),
        limit=float(np.broadcast_to(limit, used.shape)[worst]),
        at_s=float(t[worst]),
        in_s=float(step[~out].sum()),
        out_s=float(step[out].sum()),
    )


def _fewer_are_enough(test: StandardTest, quantities: Mapping[Tolerance, Quantity]) -> bool:
    """Return True if flight determines the quantity for which fewer cycles suffice within its tolerance."""
    told = [(row, q) for row, q in quantities.items() if row.quantity == test.cycles_unless and math.isfinite(q.value)]
    return any(q.std <= row.limit(q.value, abs(q.value)) for row, q in told)


def _quantity_check(row: Tolerance, test: StandardTest, flight: Quantity, simulation: Quantity, enough: bool) -> Check:
    """Return True within tolerance, if flight determines the quantity more closely than that. `enough`: cycles need not
    be counted."""
    if not math.isfinite(flight.value):
        return Check(tolerance=row, passed=None, flight=flight, simulation=simulation, why="flight does not show it")
    limit = float(row.limit(flight.value, abs(flight.value)))
    undecided = Check(tolerance=row, passed=None, limit=limit, flight=flight, simulation=simulation)
    if flight.cycles < test.cycles and not enough:
        why = f"{flight.cycles:.1f} cycles are seen, the standard asks for {test.cycles:g}"
        return replace(undecided, why=why)
    if flight.std > limit:
        return replace(undecided, why="its standard deviation from flight exceeds the tolerance")
    if not math.isfinite(simulation.value):
        return replace(undecided, passed=False, used=math.inf, why="the simulation does not show it")
    deviation = simulation.value - flight.value
    used = abs(deviation) / limit
    return replace(undecided, passed=used <= 1.0 + _ROUNDING, used=used, deviation=deviation)


def verdict(checks: Sequence[Check]) -> bool | None:
    """Return False if any row of a test fails and has no alternative that passes; None when a row is not judged."""
    best: dict[str, bool | None] = {}  # of each group of alternatives
    for i, one in enumerate(checks):
        group = one.tolerance.either or f"row {i}"
        best[group] = max(one.passed, best.get(group, False), key=_WORST_FIRST.index)
    return min(best.values(), key=_WORST_FIRST.index, default=True)


def in_words(check: Check) -> str:
    """ "pass, 43 % of the tolerance used", "fail, out for 1.2 of 6.0 s, 2.3 times the tolerance"."""
    if check.passed is None or not math.isfinite(check.used):
        return f"{VERDICTS[check.passed]}: {check.why}"
    if check.passed:
        return f"pass, {100.0 * check.used:.0f} % of the tolerance used"
    used = f"{digits(check.used, 3 if check.used < 2.0 else 2)} times the tolerance"
    if check.tolerance.quantity is not None:
        return f"fail, {used}"
    return f"fail, out for {check.out_s:.1f} of {check.in_s + check.out_s:.1f} s, {used}"


@dataclass(frozen=True, eq=False, kw_only=True)
class Side:
    """A simulation in a test: what it flew, and its rows."""

    flown: Flown  # its channels, and what a controller added
    checks: tuple[Check, ...]  # of each row of the test

    @property
    def passed(self) -> bool | None:
        """Return True if the test is passed, None if it is not judged."""
        return verdict(self.checks)


@dataclass(frozen=True, kw_only=True)
class Cost:
    """Effect of taking a part out of the extended aircraft, in one test."""

    part: str  # the effect or the numbers that were taken out
    subject: str  # name of the cause, `actuator_lag(delta_e)`; "" of numbers
    changes: tuple[str, ...]  # what differs from the given aircraft, in words
    lost: tuple[str, ...]  # names of the rows that pass with it and fail without
    used: Mapping[str, float]  # row -> largest part of its tolerance that is used without it
    fails: bool  # whether the test passes with it and fails without


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class MatchedTest:
    """A test of the standard in one record.

    Attributes
    ----------
    test
        The test of the standard: its title, manoeuvre and tolerances.
    record
        The whole record.
    window
        Begin and end of the manoeuvre in the record.
    axes
        "full", "longitudinal" or "lateral": the motion that is simulated; the other motion is then the measured one.
    flight
        Measured samples, smoothed curves and derived quantities.
    sides
        The same of the simulations: "as given", and "extended" if an extended aircraft was given.
    costs
        Effect of each part of the extended aircraft on the tolerances.
    conditions
        What the test asks of file and flight, and whether it is met.
    fitted
        Whether the diagnosis fitted this record; None: not known.

    Examples
    --------
    >>> import casid as cs
    >>> proof = cs.proof_of_match("casid/cli/demo/aircraft.toml", "casid/cli/demo/m1.csv")
    >>> proof.tests[0].test.title, proof.tests[0].axes
    ('Short period dynamics', 'full')
    """

    test: StandardTest
    record: Record
    window: Window
    axes: str
    flight: Flight
    sides: Mapping[str, Side]
    costs: tuple[Cost, ...]
    conditions: tuple[Condition, ...] = ()
    fitted: bool | None = None

    @property
    def unmet(self) -> tuple[Condition, ...]:
        """Conditions that the flight does not meet: the test then proves nothing."""
        return tuple(one for one in self.conditions if one.met is False)

    def outcome(self, label: str) -> str:
        """ "pass", "fail", "not judged", or "in tolerance, conditions not met" of the side "as given" or "extended"."""
        word = VERDICTS[self.sides[label].passed]
        return "in tolerance, conditions not met" if word == "pass" and self.unmet else word

    @property
    def shortfalls(self) -> tuple[str, ...]:
        """Rests that the standard asks for, and the record does not have."""
        return tuple(f"{str(one)[0].upper()}{str(one)[1:]}." for one in self.unmet if one.of_rest)

    @property
    def passed(self) -> bool | None:
        """Return True if the last side passes, None if it is not judged."""
        return list(self.sides.values())[-1].passed
