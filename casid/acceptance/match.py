"""Proof of match: flight against simulation, as given and extended, by the tolerances of a standard."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from casid.acceptance.checks import Check, Flight, checks_of, flight_of, smoothed_channels, verdict
from casid.acceptance.findings import FoundPart, found_parts
from casid.acceptance.flown import DIRECT, Flown, fly
from casid.acceptance.manoeuvres import MANOEUVRES, Window, window_between, windows
from casid.acceptance.smoothing import Smooth
from casid.acceptance.tolerances import CALIBRATED, Standard, StandardTest, told
from casid.arguments import given as named
from casid.arguments import number
from casid.errors import InputError, unknown
from casid.model.aircraft import Aircraft
from casid.model.applied import axes_of
from casid.model.dynamics import has_aerodynamics, unwrapped
from casid.model.given import given_aircraft
from casid.model.numbers import digits
from casid.records.given import given_records
from casid.records.record import Record
from casid.signals import si_factor
from casid.views import view

if TYPE_CHECKING:
    from pandas import DataFrame

GIVEN, EXTENDED = "as given", "extended"
_VERDICTS = {True: "pass", False: "fail", None: "not judged"}
_FEWEST = 16  # samples of a manoeuvre


@dataclass(frozen=True, eq=False, kw_only=True)
class Side:
    """A simulation in a test: what it flew, and its rows.

    Attributes
    ----------
    flown
        Its channels, and what a controller added.
    checks
        Of each row of the test.
    """

    flown: Flown
    checks: tuple[Check, ...]

    @property
    def passed(self) -> bool | None:
        """Of the test; None: it is not judged."""
        return verdict(self.checks)


@dataclass(frozen=True, kw_only=True)
class Cost:
    """What a part of the extended aircraft is worth in a test.

    Attributes
    ----------
    part
        The effect or the numbers that were taken out.
    lost
        Names of the rows that pass with it and fail without.
    used
        Row -> largest part of its tolerance that is used without it.
    fails
        Whether the test passes with it and fails without.
    """

    part: str
    lost: tuple[str, ...]
    used: Mapping[str, float]
    fails: bool


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class MatchedTest:
    """A test of the standard in one record.

    Attributes
    ----------
    test
        Of the standard.
    record
        The record, whole.
    window
        Where its manoeuvre is.
    axes
        "full", or those that move; the other motion is then as flight has it.
    flight
        Samples, curves and quantities of flight.
    sides
        "as given", and "extended" where there is one.
    costs
        Of each part of the extended aircraft.
    """

    test: StandardTest
    record: Record
    window: Window
    axes: str
    flight: Flight
    sides: Mapping[str, Side]
    costs: tuple[Cost, ...]

    @property
    def shortfalls(self) -> tuple[str, ...]:
        """What the standard asks of the record besides, and the record does not have."""
        test, window = self.test, self.window
        if not MANOEUVRES[test.manoeuvre].inputs:  # where in the window it begins is not known
            parts = [("in all", window.end - window.start, test.before_s + test.after_s)]
        else:
            parts = [("before the manoeuvre", window.begin - window.start, test.before_s)]
            parts.append(("after the last movement", window.rest, test.after_s))
        return tuple(
            f"The record has {has:.1f} s {where}; the standard asks for {wanted:g} s."
            for where, has, wanted in parts
            if has < wanted - 0.05
        )

    @property
    def passed(self) -> bool | None:
        """Of the last side."""
        return list(self.sides.values())[-1].passed


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class ProofOfMatch:
    """What `proof_of_match` gives.

    Attributes
    ----------
    standard
        The tolerance table.
    aircraft
        Side -> name of its aircraft.
    tests
        Every test that was flown, in the order of the standard.
    left_out
        Id of a test that was not -> why.
    closed_loop
        Whether small corrections of the surfaces followed the measured attitude.
    """

    standard: Standard
    aircraft: Mapping[str, str]
    tests: tuple[MatchedTest, ...]
    left_out: Mapping[str, str]
    closed_loop: bool

    @property
    def passed(self) -> bool:
        """Whether the extended aircraft passes every test (the given one, where it is alone); one that is not judged is
        not passed."""
        return all(one.passed is True for one in self.tests)

    @property
    def sentence(self) -> str:
        """How many tests each side passes."""
        told_of = []
        for label in self.aircraft:
            outcomes = [one.sides[label].passed for one in self.tests]
            left = f", and {outcomes.count(None)} cannot be judged" if None in outcomes else ""
            told_of.append(
                f"{label} it passes {outcomes.count(True)} of {len(outcomes)} tests and fails {outcomes.count(False)}{left}"
            )
        said = "; ".join(told_of)
        return f"{said[0].upper()}{said[1:]}."

    def to_dict(self) -> dict[str, Any]:
        """As `match.json`, "casid.match/1": SI units and radians; what is no number is null."""
        standard = {key: getattr(self.standard, key) for key in ("name", "edition", "source")}
        return {
            "schema": "casid.match/1",
            "passed": self.passed,
            "sentence": self.sentence,
            "standard": standard,
            "aircraft": dict(self.aircraft),
            "closed_loop": self.closed_loop,
            "tests": [_test_dict(one) for one in self.tests],
            "left_out": [{"test": test, "because": why} for test, why in self.left_out.items()],
        }

    def to_frame(self) -> DataFrame:
        """A row for each row of each test, as a pandas data frame; needs the extra `pandas`."""
        return view("match.frame")(self)

    def plot(self, test: str | None = None) -> Any:
        """The figure of a test by its id, of the first without: flight, simulations and tolerance bands.

        Returns a matplotlib figure, which pyplot has: a notebook shows it, and `plt.show()`. Raises InputError for a
        test that was not flown.
        """
        return view("match.plot")(self, test)

    def report(self, folder: str | Path) -> None:
        """Write `match.html`, one test per printed page, and `match_figures/*.svg` into a folder, which is made."""
        view("match.report")(self, folder)

    def __str__(self) -> str:
        return "\n".join(_lines(self))

    def __repr__(self) -> str:
        counts = ", ".join(f"{sum(one.passed is v for one in self.tests)} {word}" for v, word in _VERDICTS.items())
        return f"<ProofOfMatch by {self.standard.name}: {len(self.tests)} tests: {counts}>"


def proof_of_match(
    aircraft: Aircraft | str | Path,
    records: Record | str | Path | Sequence[Record | str | Path],
    *,
    extended: Aircraft | str | Path | None = None,
    tolerances: Standard | str | Path = "part60",
    tests: Iterable[str] | Mapping[str, tuple[float, float] | None] | None = None,
    axes: str | None = None,
    closed_loop: bool = False,
) -> ProofOfMatch:
    """Compare simulations with flight by the tolerances of a standard.

    Every test of the table whose manoeuvre a record shows is flown open loop, from the measured state at its beginning
    and with the inputs of flight. A time history must be within tolerance at every sample; the noise of the measured
    one is smoothed before. Derived quantities are measured from flight and simulation in the same way. With an extended
    aircraft each part that it has and the given one lacks is taken out in turn: which tolerances it costs is told.

    Parameters
    ----------
    aircraft
        The simulation as given, or its file.
    records
        Flight records, or their files.
    extended
        The extended aircraft, or its file.
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
    own = given_aircraft(aircraft, "proof_of_match")
    sides = {GIVEN: own}
    if extended is not None:
        sides[EXTENDED] = given_aircraft(extended, "proof_of_match: extended")
    read = given_records(records, "proof_of_match")
    if not read:
        raise InputError("proof_of_match: records is empty; expected at least one record")
    standard = tolerances if isinstance(tolerances, Standard) else Standard.read(tolerances)
    asked = _asked(tests, standard, read)
    parts = found_parts(own, sides[EXTENDED]) if EXTENDED in sides else ()
    left_out: dict[str, str] = {}
    flown: list[MatchedTest] = []
    for record in map(_without_jumps, read):
        smoothed = smoothed_channels(record, _looked_at(standard.tests[name] for name in asked))
        chosen = _windows(asked, standard, record, smoothed, left_out)
        flight = _Flight(record=record, smoothed=smoothed, axes=axes or _axes(own, record), closed=closed_loop)
        flown += _match(flight, chosen, sides, parts)
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
    )


def _axes(aircraft: Aircraft, record: Record) -> str:
    """What the surfaces of a record allow and the aircraft has aerodynamics of."""
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
        if name not in standard.tests:
            raise unknown("test", str(name), standard.tests, standard.name)
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
        places = (
            (window_between(record, test.manoeuvre, *at),) if at else windows(record, test.manoeuvre, test.before_s)
        )
        if not places:
            known = bool(MANOEUVRES[test.manoeuvre].inputs)
            why = f"no {test.manoeuvre} is found" if known else f"no input tells of a {test.manoeuvre}: give its time"
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
    low, high = one.peak_from / factor, one.peak_to / factor
    return f"{told(one.channel)} peaks at {peak / factor:.3g} {one.unit}, the standard asks for {low:g} to {high:g}"


def _looked_at(tests: Iterable[StandardTest]) -> list[str]:
    """Channels whose curves are needed: what tests compare, and what tells the state."""
    seen = set(DIRECT)
    for test in tests:
        seen |= {*test.channels, *([test.condition.channel] if test.condition else [])}
    return sorted(seen)


@dataclass(frozen=True, eq=False, kw_only=True)
class _Flight:
    """A record, its smoothed channels, and how it is flown."""

    record: Record
    smoothed: Mapping[str, Smooth]
    axes: str
    closed: bool


def _match(
    flight: _Flight,
    chosen: Sequence[tuple[StandardTest, Window]],
    sides: Mapping[str, Aircraft],
    parts: Sequence[FoundPart],
) -> list[MatchedTest]:
    """The tests of one record. A window that several tests share is flown once."""
    if not chosen:
        return []
    record = flight.record
    wanted = sorted({"V" if name == CALIBRATED else name for test, _ in chosen for name in test.channels})
    places = tuple(dict.fromkeys(window for _, window in chosen))
    flights = [flight_of(test, record, flight.smoothed, window) for test, window in chosen]
    curves = {name: one.curve for name, one in flight.smoothed.items()}

    def judged(aircraft: Aircraft) -> list[Side]:
        flown = fly(aircraft, record, curves, flight.axes, wanted, places, flight.closed)
        by_window = dict(zip(places, flown, strict=True))
        return [
            Side(flown=by_window[window], checks=checks_of(test, record, window, measured, by_window[window]))
            for (test, window), measured in zip(chosen, flights, strict=True)
        ]

    by_side = {label: judged(one) for label, one in sides.items()}
    without = [(part.title, judged(part.without)) for part in parts]
    return [
        MatchedTest(
            test=test,
            record=record,
            window=window,
            axes=flight.axes,
            flight=flights[i],
            sides={label: some[i] for label, some in by_side.items()},
            costs=tuple(_cost(title, by_side[EXTENDED][i], some[i]) for title, some in without),
        )
        for i, (test, window) in enumerate(chosen)
    ]


def _cost(title: str, having: Side, lacking: Side) -> Cost:
    pairs = list(zip(having.checks, lacking.checks, strict=True))
    return Cost(
        part=title,
        lost=tuple(b.tolerance.name for a, b in pairs if a.passed is True and b.passed is False),
        used={b.tolerance.name: b.used for _, b in pairs},
        fails=having.passed is True and lacking.passed is False,
    )


def _nothing(left: Mapping[str, str]) -> str:
    told_of = "; ".join(f"{name}: {why}" for name, why in list(left.items())[:3])
    more = f"; and {len(left) - 3} more" if len(left) > 3 else ""
    return f"not all that was asked for can be compared: {told_of}{more}"


def _test_dict(one: MatchedTest) -> dict[str, Any]:
    test = one.test
    return {
        "id": test.id,
        "title": test.title,
        "paragraph": test.paragraph,
        "manoeuvre": test.manoeuvre,
        "record": one.record.name,
        "start_s": one.window.start,
        "begin_s": one.window.begin,
        "shortfalls": list(one.shortfalls),
        "end_s": one.window.end,
        "axes": one.axes,
        "passed": one.passed,
        "noise": dict(one.flight.noise),
        "sides": {label: _side_dict(side) for label, side in one.sides.items()},
        "costs": [
            {"part": c.part, "lost": list(c.lost), "fails": c.fails, "used": {n: _plain(u) for n, u in c.used.items()}}
            for c in one.costs
        ],
    }


def _side_dict(side: Side) -> dict[str, Any]:
    added = {
        name: {"rms": float(np.sqrt(np.mean(values**2))), "peak": float(np.abs(values).max())}
        for name, values in side.flown.corrections.items()
    }
    rows = []
    for check in side.checks:
        row = asdict(check.tolerance)
        numbers = {key: _plain(getattr(check, key)) for key in ("used", "deviation", "limit", "at_s", "in_s", "out_s")}
        both = {key: getattr(check, key) for key in ("flight", "simulation")}
        told_of = {key: None if q is None else {k: _plain(v) for k, v in asdict(q).items()} for key, q in both.items()}
        rows.append(
            {"name": check.tolerance.name, **row, "passed": check.passed, **numbers, **told_of, "why": check.why}
        )
    return {"passed": side.passed, "corrections": added, "diverged": side.flown.diverged, "rows": rows}


def _plain(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _lines(proof: ProofOfMatch) -> Iterable[str]:
    """The result as a terminal shows it: a line for each row, and below a test what its parts cost."""
    loop = "closed loop, corrections of the surfaces follow flight" if proof.closed_loop else "open loop"
    yield f"Proof of match by {proof.standard.name}, {proof.standard.edition}; {loop}"
    yield proof.sentence
    for one in proof.tests:
        verdicts = ", ".join(f"{label} {_VERDICTS[side.passed]}" for label, side in one.sides.items())
        where = f"{one.record.name} {one.window.start:.1f} to {one.window.end:.1f} s"
        yield f"\n{one.test.id} {one.test.title}, {where}: {verdicts}"
        for i, row in enumerate(one.test.tolerances):
            cells = [f"{label} {in_words(side.checks[i])}" for label, side in one.sides.items()]
            yield f"  {row.words} ({row}): {'; '.join(cells)}"
        words = {row.name: row.words for row in one.test.tolerances}
        for cost in (each for each in one.costs if each.lost):
            what = "the test fails" if cost.fails else "the test still passes"
            yield f"  without {cost.part}: out of tolerance in {', '.join(words[n] for n in cost.lost)}; {what}"
        yield from (f"  {said}" for said in one.shortfalls)
    if proof.left_out:
        yield "\nNot compared:"
    for name, why in proof.left_out.items():
        yield f"  {name} {proof.standard.tests[name].title}: {why}"


def in_words(check: Check) -> str:
    """ "pass, 43 % of the tolerance used", "fail, out for 1.2 of 6.0 s, 2.3 times the tolerance"."""
    if check.passed is None or not math.isfinite(check.used):
        return f"{_VERDICTS[check.passed]}: {check.why}"
    if check.passed:
        return f"pass, {100.0 * check.used:.0f} % of the tolerance used"
    used = f"{digits(check.used, 3 if check.used < 2.0 else 2)} times the tolerance"
    if check.tolerance.quantity is not None:
        return f"fail, {used}"
    return f"fail, out for {check.out_s:.1f} of {check.in_s + check.out_s:.1f} s, {used}"
