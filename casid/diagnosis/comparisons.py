"""Every comparison by which a cause is named or refused: its name in a trace, and what it says to an engineer.

They stand in the order in which a diagnosis asks them. `gates.py` has the rules of those that need more than a value
and a threshold.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from casid.keeping import plain
from casid.model.numbers import digits


@dataclass(frozen=True, kw_only=True)
class Gate:
    """One comparison of a value with a threshold.

    Attributes
    ----------
    gate
        The quantity that is compared, in a few words.
    value, threshold
        The numbers that are compared.
    criterion
        Name of the threshold in `Criteria`, as "significance.search"; empty for a limit of the cause itself or a
        logical condition.
    least
        Whether the value must be at least the threshold; otherwise at most.
    or_else
        Alternative gates, one of which is sufficient if this comparison fails.

    Examples
    --------
    >>> import casid as cs
    >>> gate = cs.Gate(gate="share", value=0.4, threshold=1.0, criterion="naming.share", least=True)
    >>> gate.passed
    False
    """

    gate: str
    value: float
    threshold: float
    criterion: str = ""
    least: bool = True
    or_else: tuple[Gate, ...] = ()

    @property
    def holds(self) -> bool:
        """Return True if the comparison itself holds, without the alternatives."""
        return self.value >= self.threshold if self.least else self.value <= self.threshold

    @property
    def passed(self) -> bool:
        """Return True if the comparison holds or one of the alternatives passes."""
        return self.holds or any(other.passed for other in self.or_else)

    def __str__(self) -> str:
        sign = ">=" if self.least else "<="
        by = f" [{self.criterion}]" if self.criterion else ""
        others = "".join(f"; or {other}" for other in self.or_else)
        value = f"{self.value:.4g}" if math.isfinite(self.value) else "without bound"
        return f"{self.gate}: {value} {sign} {self.threshold:.4g}{by}{others}"

    def to_dict(self) -> dict[str, Any]:
        """An entry of `gates` in diagnosis.json."""
        return plain(self, "gate value threshold criterion least passed" + (" or_else" if self.or_else else ""))

    @classmethod
    def from_dict(cls, entry: Mapping[str, Any]) -> Gate:
        """The gate of an entry of ``gates`` in diagnosis.json. The outcome gives the sign of an infinite number."""
        others = tuple(cls.from_dict(other) for other in entry.get("or_else", ()))
        least = entry.get("least", True)
        holds = entry["passed"] and not any(other.passed for other in others)
        infinite = math.inf if holds == least else -math.inf
        return cls(
            gate=entry["gate"],
            value=infinite if entry["value"] is None else float(entry["value"]),
            threshold=-infinite if entry["threshold"] is None else float(entry["threshold"]),
            criterion=entry["criterion"],
            least=least,
            or_else=others,
        )


def all_passed(gates: Iterable[Gate]) -> bool:
    """Return True if every gate passed."""
    return all(gate.passed for gate in gates)


@dataclass(frozen=True)
class Comparison:
    """A comparison that decisions are made of.

    name           what is compared, in a trace; a gate of it may add where
    fails, passes  the clause for a cause that fails it, and for one that passes it, "" for none. {v}: the value, {t}:
                   the threshold, {p}: the value in per cent, {first}: the cause that came first, {behind}: by how much
                   that fits better, {rest}: what the gate adds to the name
    least          whether the value must be at least the threshold; otherwise at most
    """

    name: str
    fails: str
    passes: str = ""
    least: bool = True

    def of(
        self, value: float, threshold: float, criterion: str = "", or_else: Iterable[Gate] = (), where: str = ""
    ) -> Gate:
        """The gate of a value, with the name of the criterion of its threshold; `where` is added to its name."""
        return Gate(
            gate=self.name + where,
            value=float(value),
            threshold=float(threshold),
            criterion=criterion,
            least=self.least,
            or_else=tuple(or_else),
        )

    def failed(self, where: str = "") -> Gate:
        """The gate of a condition that is known not to hold."""
        return self.of(0.0, 1.0, where=where) if self.least else self.of(1.0, 0.0, where=where)


# --- what the data are worth ------------------------------------------------------------------------------------------
ODDS = Comparison("odds against records that are well", "the odds against records without a fault are {v} to 1")
DATA_AT_FAULT = Comparison("the data are at fault", "{rest}", least=False)

# --- before a fit -----------------------------------------------------------------------------------------------------
PREDICTED = Comparison("predicted statistic", "it would improve the fit by {v} in 2 ln L, and {t} is needed to try it")
PREDICTED_SIZE = Comparison("predicted size", "its predicted size is {v} of the size that matters")
PREDICTED_CLEARNESS = Comparison("predicted clearness", "its predicted size is too uncertain to be tried")
PLACES = Comparison("places left", "others are predicted to explain more, and only the best few are fitted")
BESIDE_TURBULENCE = Comparison(
    "predicted statistic beside turbulence",
    "turbulence explains as much: {v} in 2 ln L is predicted, and {t} is needed to try it",
)
WORTH_FITTING = Comparison(
    "found by kinematics at half its size", "the kinematics, which need no aerodynamics, do not show it"
)
PROMISE = Comparison("predicted statistic, of what it needs", "it would reach {p} of what a name needs")
SIMULATED = Comparison("records that can be simulated with it", "the simulation diverges with it")
TIME_LEFT = Comparison("time left", "no time was left to fit it")

# --- a fitted cause alone ---------------------------------------------------------------------------------------------
GAIN = Comparison(
    "gain",
    "it improves the fit by {v} in 2 ln L, and {t} is needed",
    "it improves the fit by {v} in 2 ln L, and {t} was needed",
)
SMALLEST = Comparison("smallest possible", "its size, {v}, is below the smallest possible, {t}")
LARGEST = Comparison("largest possible", "its size, {v}, is above the largest possible, {t}", least=False)
MATTERS = Comparison(
    "size, of what matters", "its size is {v} of the size that matters", "its size is {v} times the one that matters"
)
CLEARNESS = Comparison("clearness", "its size is too uncertain")
ONSET = Comparison("onset after the beginning of a record", "it begins with the record, and is no event")
SUDDEN = Comparison("gain of the jump over a slow change", "a slow change explains as much as a sudden one")
ALONE = Comparison("gain of the gust over those at other times", "gusts at other times explain as much")

# --- the kinematics, which contain no aerodynamics --------------------------------------------------------------------
FOUND_BY_KINEMATICS = Comparison(
    "found by kinematics",
    "the kinematics, which need no aerodynamics, do not find it ({p} of its size)",
    "the kinematics, which need no aerodynamics, find it too",
)
CONTRADICTED_SIZE = Comparison("contradicted size", "the kinematics contradict its size", least=False)
PREDICTED_BY_KINEMATICS = Comparison(
    "predicted kinematic gain", "only the kinematics could show it, and these records are too short of motion"
)
KINEMATIC_GAIN = Comparison("kinematic gain", "the kinematics contradict it")
CONFIRMED = Comparison("confirmed by kinematics", "the kinematics do not confirm it")

# --- the last cause of a set, and the causes beside it ----------------------------------------------------------------
SURE = Comparison(
    "size, in corrected standard deviations",
    "its size is {v} standard deviations from zero, and {t} are needed",
    "its size is {v} standard deviations from zero",
)
STILL_MISSING = Comparison(
    "part still missing",
    "{p} of what was missing is still missing with it",
    "{p} of what was missing is left with it",
    least=False,
)
MISSING_GAIN = Comparison("gain still missing", "{v} in 2 ln L is still missing where it acts", least=False)
MISSING_SIZE = Comparison(
    "size still missing at its port, of what matters",
    "{v} times the size that matters is still missing where it acts",
    least=False,
)
ANY_INPUT = Comparison("gain, of what any input gains there", "an unknown input at its place explains more")
NEWLY_MISSING = Comparison(
    "size newly missing, of what matters", "with it, something else is missing{rest}", least=False
)
BEHIND = Comparison(
    "gain behind the first, of what is equivalent",
    "it fits worse than {first}{behind}",
    "it fits as well as {first}",
    least=False,
)
NONE_REFUSED = Comparison("refused causes of its set", "another cause of its set was refused{rest}", least=False)
BEST_FORM = Comparison("best of the forms of this cause", "another form of it explains more")
DECIDED_BEFORE = Comparison("decided before", "a fault that is too small to matter explains more: {rest}")
FIRST_IS_NAMED = Comparison("first of its set is named", "the cause that leads its set was not named{rest}")

# --- the final model and the held-out records -------------------------------------------------------------------------
STILL_NEEDED = Comparison("still in the model beside later causes", "later causes made it unnecessary")
VALUES_ALONE = Comparison(
    "error that values alone leave, of that beside it",
    "values alone leave {v} times the error",
    "values alone leave {v} times the error",
)
BORNE_OUT = Comparison("gain with held-out records", "the held-out records contradict it", "the held-out records agree")
GAIN_HELD_OUT = Comparison(
    "gain on held-out records", "the held-out records contradict it", "the held-out records agree"
)
UNUSUAL = Comparison("expected of any aircraft", "every aircraft has it, and it is no larger than usual", least=False)
FOLLOWS_INPUTS = Comparison(
    "gain of earlier inputs on the innovations", "earlier inputs improve it by {v} in 2 ln L, and {t} is needed"
)
COMMON = Comparison("odds against single errors, 2 ln", "single errors explain as much")
INPUT_GAIN = Comparison(
    "gain of an input of any shape",
    "an unknown input there improves the fit by {v} in 2 ln L, and {t} is needed",
    "an unknown input there improves the fit by {v} in 2 ln L",
)
LEFT = Comparison("left beside causes, slow noise and turbulence", "named causes, slow noise and turbulence explain it")
RECORDED = Comparison("never recorded, and so not judged", "it was never recorded, and is not judged", least=False)

FINAL = ", beside all causes"  # what a gate that is asked again in the final model adds to its name
_BY_NAME = {one.name: one for one in tuple(globals().values()) if isinstance(one, Comparison)}
_LONGEST_FIRST = sorted(_BY_NAME, key=len, reverse=True)


def clause(gate: Gate, first: str, behind: float) -> str:
    """Return what a gate says of a cause; "" where it says nothing to an engineer.

    Parameters
    ----------
    gate
        The gate.
    first
        The cause that explains most in this round.
    behind
        By how much that one fits better, in 2 ln L; NaN where it is not known.
    """
    begin = next((one for one in _LONGEST_FIRST if gate.gate.startswith(one)), "")
    if not begin:
        return "" if gate.passed else gate.gate
    by = f" by {digits(behind, 2)} in 2 ln L" if math.isfinite(behind) and behind > 0.0 else ""
    words = {
        "v": digits(gate.value, 3) if math.isfinite(gate.value) else "any number",
        "t": digits(gate.threshold, 3),
        "p": f"{100.0 * gate.value:.0f} %",
        "rest": gate.gate.removeprefix(begin).removesuffix(FINAL).lstrip(",:").strip(),
        "first": first or "the first",
        "behind": by,
    }
    said = _BY_NAME[begin]
    return (said.passes if gate.passed else said.fails).format(**words)
