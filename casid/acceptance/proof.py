"""What a proof of match gives: tests, their rows for each simulation, and what parts of the extended aircraft cost."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from casid.acceptance.checks import Check, Flight, verdict
from casid.acceptance.flown import Flown
from casid.acceptance.manoeuvres import MANOEUVRES, Window
from casid.acceptance.tolerances import Standard, StandardTest
from casid.model.numbers import digits
from casid.records.record import Record
from casid.views import view

if TYPE_CHECKING:
    from pandas import DataFrame

GIVEN, EXTENDED = "as given", "extended"
_VERDICTS = {True: "pass", False: "fail", None: "not judged"}


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

    Examples
    --------
    >>> import casid as cs
    >>> proof = cs.proof_of_match("casid/cli/demo/aircraft.toml", "casid/cli/demo/m1.csv")
    >>> proof.standard.name, len(proof.tests)
    ('14 CFR Part 60, appendix A, table A2A', 4)
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
            passed, failed = outcomes.count(True), outcomes.count(False)
            told_of.append(f"{label} it passes {passed} of {len(outcomes)} tests and fails {failed}{left}")
        said = "; ".join(told_of)
        return f"{said[0].upper()}{said[1:]}."

    def to_dict(self) -> dict[str, Any]:
        """As `match.json`, "casid.match/1": SI units and radians; what is no number is null.

        Returns
        -------
        dict
            Numbers, texts, lists and tables, as JSON holds them.
        """
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
        """A row for each row of each test, as a pandas data frame; needs the extra `pandas`.

        Returns
        -------
        DataFrame
            Data frame of pandas.
        """
        return view("match.frame")(self)

    def plot(self, test: str | None = None) -> Any:
        """The figure of a test by its id, of the first without: flight, simulations and tolerance bands.

        Returns a matplotlib figure, which pyplot has: a notebook shows it, and `plt.show()`. Raises InputError for a
        test that was not flown.

        Parameters
        ----------
        test
            Paragraph of the standard, like ``2.c.10``.

        Returns
        -------
        Figure
            Figure of matplotlib.
        """
        return view("match.plot")(self, test)

    def report(self, folder: str | Path) -> None:
        """Write `match.html`, one test per printed page, and `match_figures/*.svg` into a folder, which is made.

        Parameters
        ----------
        folder
            Name of the folder.
        """
        view("match.report")(self, folder)

    def __str__(self) -> str:
        return "\n".join(_lines(self))

    def __repr__(self) -> str:
        counts = ", ".join(f"{sum(one.passed is v for one in self.tests)} {word}" for v, word in _VERDICTS.items())
        return f"<ProofOfMatch by {self.standard.name}: {len(self.tests)} tests: {counts}>"


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
