"""Another cause in the place of one that was named, and what can be named together with it.

Where the noise of the records is what a fit leaves, a wrong cause leaves nothing missing: what it cannot explain goes
into the noise. Two causes may explain about as much, as a lag of a vane and a vane metres ahead do. They are then
compared by the best joint fit with further causes: one may distort what the other leaves for a third to explain.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from casid.diagnosis.decision import all_passed
from casid.diagnosis.evidence.evidence import weigh
from casid.diagnosis.evidence.screening import screen
from casid.diagnosis.kinematics.kinematics import with_causes
from casid.diagnosis.naming.naming import (
    Naming,
    all_reconsidered,
    believed,
    is_dead_heat,
    near_rivals,
    one_round,
    with_best_of,
)
from casid.diagnosis.naming.round import Trial
from casid.model.effect import Effect


def best_branch(naming: Naming, catalogue: Sequence[Effect], required: float, report: Callable[[str], None]) -> Naming:
    """The naming, or the one that begins with a near rival in the place of one of its causes, whichever is most likely
    with all that is named beside it. Only where the noise is what the fit leaves, and in calm air: turbulence takes up
    what a wrong cause leaves, whatever is named beside it, and each of its branches takes minutes."""
    fitted = naming.evidence.fit
    if not fitted.flight.noise_by_fit or fitted.noise.coloured:
        return naming
    best = naming
    for at, round_ in enumerate(naming.rounds):
        rivals = near_rivals(round_, naming.criteria) if round_.named else []
        for rival in rivals[: naming.criteria.numerics.naming.branches]:
            report(f"naming with {rival.candidate.name} instead")
            other = _followed(_only_named(naming), at, rival, catalogue, required, best)
            if _cost(other) < _cost(best) - naming.criteria.screening.equivalent:
                best = other
    return best if best is naming else all_reconsidered(best, required)


def _followed(
    naming: Naming, at: int, rival: Trial, catalogue: Sequence[Effect], required: float, best: Naming
) -> Naming:
    """The branch of a rival, with what can be named beside it, as long as it may become better than the `best`. After a
    dead heat the naming goes on from there anew."""
    anew = is_dead_heat(naming.rounds[at].leader, rival, naming.criteria)
    other = with_best_of(_as_it_stood(naming, at) if anew else naming, at, (rival,), required)
    if other.rounds[at].leader.effect.key != rival.effect.key:
        return best
    for _ in range(naming.criteria.numerics.naming.rounds - (at if anew else 0)):
        if not anew and _cost(other) - _promised(other, catalogue) > _cost(best):
            break
        further = one_round(other, catalogue, required)
        if not further.rounds[-1].named or not all_passed(believed(other, further)):
            break
        other = further
    return other


def _promised(naming: Naming, catalogue: Sequence[Effect]) -> float:
    """The most that a further fault of an instrument may gain."""
    taken = {one.effect.key for one in naming.evidence.fit.attached}
    ranked = screen(naming.evidence, [e for e in catalogue if e.key not in taken and e.of_an_instrument])
    return float(ranked[0].net) if ranked else -np.inf


def _as_it_stood(naming: Naming, at: int) -> Naming:
    """The naming after one of its rounds: what was named later may be what the wrong cause of two had left."""
    fitted = naming.rounds[at].fitted
    kinematic = None if naming.kinematic is None else with_causes(naming.kinematic, fitted.attached)
    return replace(naming, evidence=weigh(fitted), kinematic=kinematic, rounds=naming.rounds[: at + 1])


def _only_named(naming: Naming) -> Naming:
    """The naming without the rounds that named nothing."""
    return replace(naming, rounds=tuple(naming.named))


def _cost(naming: Naming) -> float:
    """Deviance, with the gain that is required of every cause."""
    return naming.evidence.deviance + naming.criteria.naming.gain_of_an_instrument * len(naming.named)
