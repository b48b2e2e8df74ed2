"""Proof of match: flight against simulation, as given and extended, by the tolerances of a standard."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from casid.acceptance.checks import (
    EXTENDED,
    GIVEN,
    Cost,
    MatchedTest,
    Side,
    checks_of,
    flight_of,
    smoothed_channels,
)
from casid.acceptance.checks import Flight as Measured
from casid.acceptance.conditions import conditions_of
from casid.acceptance.findings import FoundPart, found_parts
from casid.acceptance.flown import DIRECT, ToFly, fly
from casid.acceptance.justification import Findings, findings_of
from casid.acceptance.manoeuvres import MANOEUVRES, Window, window_between, windows
from casid.acceptance.proof import ProofOfMatch
from casid.acceptance.smoothing import Smooth
from casid.acceptance.tolerances import Standard, StandardTest, told
from casid.arguments import given as named
from casid.arguments import number
from casid.diagnosis.result import Diagnosis
from casid.errors import InputError, check_known
from casid.model.aircraft import Aircraft, given_aircraft
from casid.model.dynamics import has_aerodynamics
from casid.model.flown_records import axes_of
from casid.records.given import given_records
from casid.records.record import Record
from casid.records.series import unwrapped
from casid.signals import si_factor

_FEWEST = 16  # samples of a manoeuvre


def proof_of_match(
    aircraft: Aircraft | str | Path,
    records: Record | str | Path | Sequence[Record | str | Path],
    *,
    extended: Aircraft | str | Path | None = None,
    diagnosis: Diagnosis | str | Path | None = None,
    tolerances: Standard | str | Path = "part60",
    tests: Iterable[str] | Mapping[str, tuple[float, float] | None] | None = None,
    axes: str | None = None,
    closed_loop: bool = False,
) -> ProofOfMatch:
    """Compare simulations with flight by the tolerances of a standard.

    Every test of the table whose manoeuvre a record shows is flown open loop, from the measured state at its beginning
    and with the inputs of flight. A time history must be within tolerance at every sample; the noise of the measured
    one is smoothed before. Derived quantities are measured from flight and simulation in the same way. With an extended
    aircraft each part that it has and the given one lacks is taken out in turn, to find the tolerances that it costs.

    Parameters
    ----------
    aircraft
        The simulation as given, or its file.
    records
        Flight records, or their files.
    extended
        The extended aircraft, or its file.
    diagnosis
        A diagnosis of this aircraft, or the folder that `casid diagnose` wrote: each test states whether its record was
        fitted, and one that was out of tolerance has its rationale. Its extended aircraft is taken if none is given.
    tolerances
        "part60", one's own TOML file, or a `Standard`.
    tests
        Ids of tests; or id -> (start, end) on the clock of the one record [s], None: where its manoeuvre is found.
        Without, all whose manoeuvre is found.
    axes
        "full", "longitudinal" or "lateral"; default: what the surfaces of a record allow and the aircraft has
        aerodynamics of.
    closed_loop
        Add to the surfaces of flight a small correction towards the measured attitude and rates, no larger than 1 deg
        of elevator or rudder and 2 deg of aileron. What it added is in the result.

    Returns
    -------
    ProofOfMatch
        Every test of the standard that was flown, with its tolerances and results.

    Raises
    ------
    InputError
        For a test that the table does not have or that no record shows, and where nothing can be compared.

    Examples
    --------
    >>> import casid as cs
    >>> proof = cs.proof_of_match("plane.toml", "m4.csv", extended="extended.toml")  # doctest: +SKIP
    >>> print(proof)  # doctest: +SKIP
    """
    findings = None if diagnosis is None else findings_of(diagnosis)
    extended = findings.extended if extended is None and findings else extended
    own = given_aircraft(aircraft, "proof_of_match")
    sides = {GIVEN: own}
    if extended is not None:
        sides[EXTENDED] = given_aircraft(extended, "proof_of_match: extended")
    read = given_records(records, "proof_of_match")
    if not read:
        raise InputError("proof_of_match: records is empty; expected at least one record")
    standard = tolerances if isinstance(tolerances, Standard) else Standard.read(tolerances)
    asked = _asked(tests, standard, read)
    left_out: dict[str, str] = {}
    flights: list[ToFly] = []
    for record in map(_without_jumps, read):
        smoothed = smoothed_channels(record, _looked_at([standard.tests[name] for name in asked]))
        if chosen := _windows(asked, standard, record, smoothed, left_out):
            along = axes or _axes(own, record)
            flights.append(ToFly(record=record, smoothed=smoothed, axes=along, chosen=chosen))
    flown = _match(flights, sides, findings or Findings(), closed_loop)
    if tests is None:
        flown, idle = [one for one in flown if _judged(one)], [one for one in flown if not _judged(one)]
        left_out |= {one.test.id: one.sides[GIVEN].checks[0].why for one in idle}
    order = list(standard.tests)
    flown.sort(key=lambda one: order.index(one.test.id))
    left = {name: why for name, why in left_out.items() if name not in {one.test.id for one in flown}}
    if not flown or (tests is not None and left):
        raise InputError(f"proof_of_match: {_nothing(left)}")
    return ProofOfMatch(
        standard=standard,
        aircraft={label: one.name for label, one in sides.items()},
        tests=tuple(flown),
        left_out={name: left[name] for name in order if name in left},
        closed_loop=closed_loop,
        findings=findings,
    )


def _axes(aircraft: Aircraft, record: Record) -> str:
    """Return the axes that the surfaces of a record allow and for which the aircraft has aerodynamics."""
    axes = axes_of([record])
    modelled = [one for one in ("longitudinal", "lateral") if has_aerodynamics(aircraft, one)]
    return modelled[0] if axes == "full" and len(modelled) == 1 else axes


def _without_jumps(record: Record) -> Record:
    """The record with bank angle and heading that go on where they pass a full turn."""
    return record.with_channels(**{name: unwrapped(record[name]) for name in ("phi", "psi") if name in record})


def _judged(one: MatchedTest) -> bool:
    return any(check.passed is not None for side in one.sides.values() for check in side.checks)


def _asked(tests: Any, standard: Standard, records: Sequence[Record]) -> dict[str, tuple[float, float] | None]:
    """Id -> its time, where that is given."""
    if tests is None:
        return dict.fromkeys(standard.tests)
    if isinstance(tests, str) or not isinstance(tests, Iterable):
        raise InputError(f'proof_of_match: tests is {named(tests)}; expected a list of ids like ["2.c.10"]')
    asked = dict(tests) if isinstance(tests, Mapping) else dict.fromkeys(tests)
    for name, span in asked.items():
        check_known("test", (name,), standard.tests, standard.name)
        if span is None:
            continue
        where = f"proof_of_match: tests: {name}"
        if len(records) > 1:
            raise InputError(f"{where}: a time is given, but {len(records)} records; give one record")
        if not isinstance(span, Sequence) or len(span) != 2:
            raise InputError(f"{where}: the time is {named(span)}; expected (start, end) in s")
        start, end = (number(one, where) for one in span)
        t = records[0].t
        if not t[0] - 1e-9 <= start < end <= t[-1] + 1e-9:
            raise InputError(f"{where}: {start:g} to {end:g} s is not in the record, {t[0]:g} to {t[-1]:g} s")
    return asked


def _windows(
    asked: Mapping[str, tuple[float, float] | None],
    standard: Standard,
    record: Record,
    smoothed: Mapping[str, Smooth],
    left_out: dict[str, str],
) -> list[tuple[StandardTest, Window]]:
    """The tests that a record shows, and when. Why others are not: into `left_out`."""
    found = []
    for name, at in asked.items():
        test = standard.tests[name]
        how = test.manoeuvre
        places = (window_between(record, how, *at),) if at else windows(record, how, test.before_s)
        if not places:
            known = bool(MANOEUVRES[how].inputs)
            why = f"no {how} is found" if known else f"no input tells of a {how}: give its time"
            left_out.setdefault(name, why)
        for window in places:
            why = _unfit(test, record, smoothed, window)
            if why:
                left_out[name] = why
            else:
                found.append((test, window))
    return found


def _unfit(test: StandardTest, record: Record, smoothed: Mapping[str, Smooth], window: Window) -> str:
    """Why a test cannot be flown in a window; "": it can."""
    inside = (record.t >= window.start) & (record.t <= window.end)
    if inside.sum() < _FEWEST:
        return f"record '{record.name}' has {inside.sum()} samples from {window.start:g} to {window.end:g} s"
    missing = [name for name in test.channels if name not in smoothed]
    if len(missing) == len(test.channels):
        return f"record '{record.name}' has no {' and no '.join(missing)}"
    if test.condition is None:
        return ""
    one = test.condition
    if one.channel not in smoothed:
        return f"record '{record.name}' has no {one.channel}"
    peak = float(np.abs(smoothed[one.channel].curve[inside]).max())
    if one.peak_from <= peak <= one.peak_to:
        return ""
    factor = si_factor(one.unit, "")
    low, high = (bound / factor for bound in (one.peak_from, one.peak_to))
    return f"{told(one.channel)} peaks at {peak / factor:.3g} {one.unit}, the standard asks for {low:g} to {high:g}"


def _looked_at(tests: Sequence[StandardTest]) -> list[str]:
    """Channels whose curves are needed: those that tests compare, and those of the state."""
    seen = {name for test in tests for name in test.channels}
    conditions = {test.condition.channel for test in tests if test.condition}
    return sorted({*DIRECT, *seen, *conditions})


def _judged_by(
    aircraft: Aircraft, flights: Sequence[ToFly], measured: Iterable[Measured], closed: bool
) -> Iterator[Side]:
    """Every test of all flights, simulated by an aircraft; `measured` are the flight data of each."""
    of_each = iter(measured)
    for flight, flown in zip(flights, fly(aircraft, flights, closed), strict=True):
        for test, window in flight.chosen:
            found = flown[window]
            yield Side(flown=found, checks=checks_of(test, flight.record, window, next(of_each), found))


def _match(
    flights: Sequence[ToFly], sides: Mapping[str, Aircraft], findings: Findings, closed: bool
) -> list[MatchedTest]:
    """The tests of all flights."""
    parts = found_parts(sides[GIVEN], sides[EXTENDED]) if EXTENDED in sides else ()
    every = [(flight, test, window) for flight in flights for test, window in flight.chosen]
    measured = [flight_of(test, flight.record, flight.smoothed, window) for flight, test, window in every]
    by_side = {label: list(_judged_by(one, flights, measured, closed)) for label, one in sides.items()}
    without = [(part, list(_judged_by(part.without, flights, measured, closed))) for part in parts]
    return [
        MatchedTest(
            test=test,
            record=flight.record,
            window=window,
            axes=flight.axes,
            flight=measured[i],
            sides={label: some[i] for label, some in by_side.items()},
            costs=tuple(_cost(part, by_side[EXTENDED][i], some[i]) for part, some in without),
            conditions=conditions_of(test, sides[GIVEN], flight.record, flight.smoothed, window),
            fitted=findings.was_fitted(flight.record.name),
        )
        for i, (flight, test, window) in enumerate(every)
    ]


def _cost(part: FoundPart, having: Side, lacking: Side) -> Cost:
    pairs = list(zip(having.checks, lacking.checks, strict=True))
    return Cost(
        part=part.title,
        subject=part.subject,
        changes=part.changes,
        lost=tuple(b.tolerance.name for a, b in pairs if a.passed is True and b.passed is False),
        used={b.tolerance.name: b.used for _, b in pairs},
        fails=having.passed is True and lacking.passed is False,
    )


def _nothing(left: Mapping[str, str]) -> str:
    told_of = "; ".join(f"{name}: {why}" for name, why in list(left.items())[:3])
    more = f"; and {len(left) - 3} more" if len(left) > 3 else ""
    return f"not all that was asked for can be compared: {told_of}{more}"
