"""Decide what may be stated: every statement of a diagnosis passes a function here, which knows what it may not
contradict.

1. "Adequate" is said of a simulation that as given stays within the noise on held-out records, and of no other.
2. Every value of the extended model that left its stated uncertainty is reported, identifiable or not.
3. While structure is missing, or the held-out error has grown, no value is reported as measured; a cause that values
   reproduce is structure.
4. Shares of an error are from 0 to 100 % and add up to 100 %; a step that makes it worse is reported as that.
5. A probability is conditional on the catalogue. With more than twice the error of the right model left, none is
   above 90 %.
6. Held-out records differ from fitted ones by content.
7. The headline names the worst channels, and records where they differ.
8. A cause smaller than the noise of any one reading is not reported.

All functions take facts, fit nothing and return words, numbers or a reason; an empty reason means that it may be
stated.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np

from casid.diagnosis.cause import Cause
from casid.diagnosis.facts import Facts
from casid.diagnosis.given.budget import AccountStep, account_of
from casid.diagnosis.given.factors import Factor
from casid.model.numbers import digits


@dataclass(frozen=True, kw_only=True)
class Claim:
    """A statement, whether it is made, and why not."""

    in_json: ClassVar[str] = "statement said because"

    statement: str  # what is stated, in a few words
    because: str = ""  # why it is not stated; empty if it is

    @property
    def said(self) -> bool:
        """Return True if it may be stated."""
        return not self.because


def claims_of(facts: Facts) -> tuple[Claim, ...]:
    """The statements that a verdict rests on, each with the reason if it is not made."""
    return (
        Claim(statement="the simulation as given reproduces the held-out records", because=not_flown(facts)),
        Claim(statement="the values of the extended model are what the records say", because=no_values(facts)),
        Claim(statement="nothing that matters is left", because=left_over(facts)),
    )


def not_flown(facts: Facts) -> str:
    """Return why the simulation as given does not fly the held-out records; empty if it stays within the noise, or
    where this may have led the right values."""
    steps = facts.budget.together
    limit = facts.criteria.clearly
    if not math.isfinite(steps.as_given):
        return "it diverges"
    every = (steps, *facts.budget.channels.values())
    if all(one.over("as_given") <= limit or one.as_given <= one.by_chance for one in every):
        return ""
    return f"it is off by {times(steps.as_given)} the noise ({_worst(facts)})"


def adequate(facts: Facts) -> bool:
    """Return whether the simulation as given may be called adequate."""
    doubted = facts.at_fault or facts.impossible or facts.causes or facts.unexplained
    return not doubted and not not_flown(facts)


def grown(facts: Facts) -> str:
    """Return by how much the error on the held-out records grew; empty if it did not."""
    steps = facts.budget.together
    limit = facts.criteria.slightly
    if steps.structure <= limit * max(steps.data_mended, steps.floor):  # true of NaN
        return ""
    return f"the error on held-out records grew from {times(steps.data_mended)} to {times(steps.structure)} the noise"


def left_over(facts: Facts) -> str:
    """Return what is left on the held-out records beyond what the right model would leave; empty if it is little."""
    steps = facts.budget.together
    if facts.unexplained:
        return facts.unexplained[0]
    if steps.over("structure") <= facts.criteria.twice:
        return ""
    expected = f"; the right model would leave {times(steps.floor)}" if steps.floor > facts.criteria.slightly else ""
    return f"{times(steps.structure)} the noise is left{expected}"


def no_better(facts: Facts) -> bool:
    """Return whether neither causes nor re-estimated values make the error on the held-out records smaller."""
    steps = facts.budget.together
    values = facts.contradicted or facts.factors
    return not values and steps.as_given < facts.criteria.slightly * steps.structure


def no_values(facts: Facts) -> str:
    """Return why no value of the extended model is reported as measured; empty if they are."""
    if facts.at_fault:
        return "the data are at fault"
    if facts.unexplained:
        return "structure is missing"
    return grown(facts)


def told_factors(facts: Facts) -> tuple[Factor, ...]:
    """Return the groups of values whose common number may be stated; while structure is missing, of those that a cause
    makes, for its size is structure as well."""
    if facts.at_fault or grown(facts):
        return ()
    return tuple(one for one in facts.factors if one.cause or not facts.unexplained)


def probability(value: float, facts: Facts) -> float:
    """Return the probability that may be stated: 90 % of it while more than twice the error of the right model is left.

    All are lowered by one factor, so that those of combinations still add up to those of their causes.
    """
    return facts.criteria.doubtful * value if left_over(facts) else value


def stated(cause: Cause, facts: Facts) -> Cause:
    """The cause with probabilities that may be stated."""

    def of(value: Any) -> float | None:
        return None if value is None else probability(float(value), facts)

    alike = ({**one, "probability": of(one.get("probability"))} for one in cause.indistinguishable_from)
    return replace(cause, probability=of(cause.probability), alone=of(cause.alone), indistinguishable_from=tuple(alike))


def nothing_missing(value: float | None, facts: Facts) -> float | None:
    """Return the probability that no cause that matters is missing; None where the records contradict it."""
    return None if left_over(facts) else value


def explanations(
    found: Sequence[tuple[tuple[str, ...], float]], facts: Facts
) -> tuple[tuple[tuple[str, ...], float], ...]:
    """Return the combinations of causes with probabilities that may be stated; that none is missing only if it may."""
    return tuple((names, probability(p, facts)) for names, p in found if names or not left_over(facts))


def visible(cause: Cause) -> bool:
    """Return whether a cause changes some reading by more than its noise."""
    return cause.on_readings >= 1.0


def account(facts: Facts) -> tuple[AccountStep, ...]:
    """Return the steps that account for the error on the held-out records; the shares add up to 100 %."""
    worst = facts.budget.worst()[:1]
    seen = [(max((one.effect.get(name, 0.0) for name in worst), default=0.0), one) for one in facts.changed]
    named = [one for effect, one in sorted(seen, key=lambda pair: -pair[0]) if effect > 1.0]
    scaled = {name for one in facts.factors for name in one.derivatives}
    return account_of(
        facts.budget,
        {
            "data": [f"{one.target}: {one.kind.removeprefix('data_').replace('_', ' ')}" for one in facts.corrected],
            "values": [
                *(one.brief for one in facts.factors),
                *(one.change for one in named if one.parameter not in scaled),
            ],
            "structure": [one.title for one in facts.causes],
            "noise": ["moving air"] if facts.turbulent else [],
        },
    )


def percents(steps: Sequence[AccountStep]) -> list[int]:
    """Shares in whole per cent that add up to 100, by largest remainders; zeros if the simulation diverges."""
    shares = np.array([one.share for one in steps])
    if not np.isfinite(shares).all():
        return [0] * len(steps)
    whole = np.floor(100.0 * shares + 1e-9).astype(int)
    rest = 100.0 * shares - whole
    for i in np.argsort(-rest, kind="stable")[: max(100 - int(whole.sum()), 0)]:
        whole[i] += 1
    return whole.tolist()


def records_that_differ(facts: Facts) -> Mapping[str, float]:
    """Record -> error left, of the records in which much more is left than in the best; empty if they are alike."""
    left = {one.record: one.left / max(one.expected, 1.0) for one in facts.budget.by_record}
    if not left:
        return {}
    least = min(left.values())
    return {name: value for name, value in left.items() if value > facts.criteria.twice * max(least, 1.0)}


def _worst(facts: Facts) -> str:
    """The two worst channels with their errors as given."""
    labels = facts.budget.labels
    channels = facts.budget.channels
    order = sorted(channels, key=lambda name: -channels[name].as_given)
    return ", ".join(f"{labels.get(n, n)} {times(channels[n].as_given)}" for n in order[:2])


def times(ratio: float) -> str:
    """A multiple of the noise in words."""
    return f"{digits(ratio, 2)} times" if math.isfinite(ratio) else "more than any multiple of"
