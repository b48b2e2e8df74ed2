"""Hold a proof of match: tests, their rows for each simulation, and the effect of parts of the extended aircraft."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from casid.above import ask_above
from casid.acceptance.checks import EXTENDED, GIVEN, VERDICTS, MatchedTest, Side, in_words
from casid.acceptance.justification import Findings, Rationale, rationale_of
from casid.acceptance.tolerances import Standard
from casid.frames import Rows
from casid.keeping import plain

if TYPE_CHECKING:
    from pandas import DataFrame


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class ProofOfMatch:
    """Result of `proof_of_match`: every test with its rows, before and after.

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
    findings
        What the diagnosis found that gave the extended aircraft; None: there was none.

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
    findings: Findings | None = None

    @property
    def passed(self) -> bool:
        """Return True if the extended aircraft passes every test (the given one, where it is alone). One that is not
        judged, or whose conditions are not met, is not passed."""
        return all(one.passed is True and not one.unmet for one in self.tests)

    @property
    def lost(self) -> tuple[MatchedTest, ...]:
        """Tests that the given aircraft passes and the extended one fails: its change is then not acceptable."""
        return tuple(
            one
            for one in self.tests
            if EXTENDED in one.sides and one.sides[GIVEN].passed is True and one.sides[EXTENDED].passed is not True
        )

    @property
    def sentence(self) -> str:
        """Sentence on how many tests each side passes, and how many were not flown as the standard asks."""
        told_of = []
        for label in self.aircraft:
            outcomes = [one.sides[label].passed for one in self.tests]
            passed, failed, undecided = (outcomes.count(one) for one in VERDICTS)
            left = f", and {undecided} cannot be judged" if undecided else ""
            told_of.append(
                f"{label} it is within tolerance in {passed} of {len(outcomes)} tests and out in {failed}{left}"
            )
        said = "; ".join(told_of)
        idle = sum(bool(one.unmet) for one in self.tests)
        asked = f" {_counted(idle)} not flown as the standard asks, and no proof." if idle else ""
        fitted = sum(one.fitted is True for one in self.tests)
        seen = f" {_counted(fitted)} flown in records that the diagnosis fitted." if fitted else ""
        lost = f" {len(self.lost)} that were in tolerance as given no longer are." if self.lost else ""
        return f"{said[0].upper()}{said[1:]}.{asked}{seen}{lost}"

    def to_dict(self) -> dict[str, Any]:
        """Return the content of `match.json`, "casid.match/1": SI units and radians; null for what is not finite."""
        return {
            "schema": "casid.match/1",
            **plain(self, "passed sentence aircraft closed_loop"),
            "standard": plain(self.standard, "name edition source"),
            "lost": [{"test": one.test.id, "record": one.record.name} for one in self.lost],
            "tests": [_test_dict(one, rationale_of(one, self.tests, self.lost, self.findings)) for one in self.tests],
            "left_out": [{"test": test, "because": why} for test, why in self.left_out.items()],
        }

    def to_frame(self) -> DataFrame:
        """A row for each row of each test, as a pandas data frame; needs the extra `pandas`."""
        return self.rows().frame()

    def rows(self) -> Rows:
        """A row for each row of each test and side."""
        numbers = ("used", "deviation", "limit", "at_s", "in_s", "out_s")
        every = ((one, *side) for one in self.tests for side in one.sides.items())
        rows = []
        for one, label, check in ((one, label, check) for one, label, side in every for check in side.checks):
            name = f"{one.test.id} {one.record.name} {one.window.start:g} s: {check.tolerance.name}, {label}"
            values = (getattr(check, key) for key in numbers)
            rows.append((name, check.passed, *values, one.test.paragraph, check.why))
        heads = {"row": "", "passed": "", **dict.fromkeys(numbers, ".3g"), "paragraph": "", "why": ""}
        return Rows(heads=heads, rows=rows)

    def plot(self, test: str | None = None) -> Any:
        """The figure of a test like ``2.c.10``, or of the first one: flight, simulations and tolerance bands.

        Returns a matplotlib figure, which pyplot has: a notebook shows it, and `plt.show()`. Raises InputError for a
        test that was not flown.
        """
        return ask_above("ProofOfMatch.plot", self, test)

    def report(self, folder: str | Path) -> None:
        """Write `match.html`, one test per printed page, and `match_figures/*.svg` into a folder, which is made."""
        ask_above("ProofOfMatch.report", self, folder)

    def __str__(self) -> str:
        return "\n".join(_lines(self))

    def __repr__(self) -> str:
        counts = ", ".join(f"{sum(one.passed is v for one in self.tests)} {word}" for v, word in VERDICTS.items())
        return f"<ProofOfMatch by {self.standard.name}: {len(self.tests)} tests: {counts}>"


def _counted(count: int) -> str:
    return "1 test was" if count == 1 else f"{count} tests were"


def _test_dict(one: MatchedTest, rationale: Rationale | None) -> dict[str, Any]:
    test = one.test
    return {
        **plain(test, "id title paragraph manoeuvre"),
        **plain(one.window, "start_s=start begin_s=begin end_s=end"),
        **plain(one, "shortfalls axes passed conditions fitted"),
        "record": one.record.name,
        "outcomes": {label: one.outcome(label) for label in one.sides},
        "rationale": plain(rationale),
        "noise": plain(one.flight.noise),
        "sides": {label: _side_dict(side) for label, side in one.sides.items()},
        "costs": [plain(c, "part changes lost fails used") for c in one.costs],
    }


def _side_dict(side: Side) -> dict[str, Any]:
    added = {
        name: {"rms": float(np.sqrt(np.mean(values**2))), "peak": float(np.abs(values).max())}
        for name, values in side.flown.corrections.items()
    }
    told = "passed used deviation limit at_s in_s out_s flight simulation why"
    rows = [{"name": one.tolerance.name, **plain(one.tolerance), **plain(one, told)} for one in side.checks]
    return {"passed": side.passed, "corrections": added, "diverged": side.flown.diverged, "rows": rows}


def _lines(proof: ProofOfMatch) -> Iterable[str]:
    """The result as a terminal shows it: a line for each row, and below a test what its parts cost."""
    loop = "closed loop, corrections of the surfaces follow flight" if proof.closed_loop else "open loop"
    yield f"Proof of match by {proof.standard.name}, {proof.standard.edition}; {loop}"
    yield proof.sentence
    for one in proof.tests:
        verdicts = ", ".join(f"{label} {one.outcome(label)}" for label in one.sides)
        where = f"{one.record.name} {one.window.start:.1f} to {one.window.end:.1f} s"
        yield f"\n{one.test.id} {one.test.title}, {where}: {verdicts}"
        for i, row in enumerate(one.test.tolerances):
            cells = [f"{label} {in_words(side.checks[i])}" for label, side in one.sides.items()]
            yield f"  {row.words} ({row}): {'; '.join(cells)}"
        words = {row.name: row.words for row in one.test.tolerances}
        for cost in (each for each in one.costs if each.lost):
            what = "the test fails" if cost.fails else "the test still passes"
            yield f"  without {cost.part}: out of tolerance in {', '.join(words[n] for n in cost.lost)}; {what}"
        yield from (f"  not met, {said}" for said in one.unmet)
    if proof.left_out:
        yield "\nNot compared:"
    for name, why in proof.left_out.items():
        yield f"  {name} {proof.standard.tests[name].title}: {why}"
