"""A test of a standard in one record: what flight and the simulations give, and what parts of the extended one cost."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from casid.acceptance.checks import VERDICTS, Check, Flight, verdict
from casid.acceptance.conditions import Condition
from casid.acceptance.flown import Flown
from casid.acceptance.manoeuvres import Window
from casid.acceptance.tolerances import StandardTest
from casid.records.record import Record


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
