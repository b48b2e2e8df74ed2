"""What held-out records say of the causes: likelihood ratios of predictions, for the same posterior.

A cause that is there predicts records that no fit has seen; what mops up the error of a model in some records does not.
With y' the held-out records, p(E | y, y') goes as p(E | y) p(y' | y, E). The second factor is that of the fitted model,
its parameters fixed at their estimates, with the cause and, everything else fitted again, without it.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

import numpy as np

from casid.diagnosis.flight.evaluation import FlightFit
from casid.diagnosis.flight.fit import fit
from casid.diagnosis.flight.hypothesis import Attached
from casid.diagnosis.judging.held_out import judge_on
from casid.errors import InputError
from casid.records.record import Record


def predicted(
    lead: FlightFit,
    causes: Collection[str],
    rivals: Sequence[FlightFit],
    held: Sequence[Record],
    worths: Mapping[str, float],
) -> tuple[dict[str, float], list[float]]:
    """Logarithms of likelihood ratios of predictions, readings counted for what they are `worths`: name of a cause of
    the lead -> of the lead to it without that cause; and of each rival to the lead.

    None of what held-out records need not have: an event, a cause of some records.
    """
    if not held:
        return {}, []
    whole, found = _deviance(judge_on(held, lead), worths), {}
    for one in lead.attached:
        if one.name not in causes or not _repeats(one):
            continue
        others = [other for other in lead.attached if other.name != one.name]
        try:
            without = fit(lead.flight, others, lead.noise, lead, iterations=6, tolerance=2.0)
            found[one.name] = 0.5 * (_deviance(judge_on(held, without), worths) - whole)
        except (InputError, ArithmeticError):
            continue  # an aircraft that cannot fly without it says nothing
    return found, [0.5 * (whole - _deviance(judge_on(held, rival), worths)) for rival in rivals]


def _repeats(one: Attached) -> bool:
    return not one.effect.timed and not one.records


def _deviance(held: FlightFit, worths: Mapping[str, float]) -> float:
    """-2 log likelihood of records, each channel to the power of what its readings are worth."""
    power = np.array([worths.get(name, 1.0) for name in held.model.outputs])
    squares = np.sum(held.white**2, axis=(0, 1))
    rest = held.data_deviance - float(squares.sum())
    return float(power @ squares) + float(power.mean()) * rest
