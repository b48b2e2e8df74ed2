"""What remains unexplained when the causes are named."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from casid.diagnosis.cause import Cause
from casid.diagnosis.causes import minor_trials, still_missing, too_small
from casid.diagnosis.decision import at_least
from casid.diagnosis.engine.acceptance import required_gain
from casid.diagnosis.engine.held_out import Kept, judge_on, with_events
from casid.diagnosis.engine.search import State
from casid.diagnosis.evidence.evidence import weigh
from casid.diagnosis.evidence.missing_input import MissingInput, missing_inputs
from casid.diagnosis.flight.evaluation import FlightFit
from casid.diagnosis.flight.fit import fit
from casid.diagnosis.flight.hypothesis import Attached
from casid.diagnosis.flight.noise import as_coloured_as_left, as_slow_as_left
from casid.diagnosis.sentences import SLOW_NOISE, noted


def what_is_left(
    kept: Kept,
    state: State,
    left: Sequence[MissingInput],
    judged: tuple[tuple[Cause, ...], tuple[Cause, ...]],
) -> tuple[tuple[Cause, ...], list[MissingInput]]:
    """The minor causes and the latent inputs that no cause explains.

    Latent inputs are dropped if causes that are too small to matter explain them.

    Parameters
    ----------
    kept
        The model after the test on the held-out records.
    state
        The final state of the search.
    left
        Latent inputs in the fitted records.
    judged
        Named causes and minor ones so far.

    Returns
    -------
    minor
        The minor causes, with those added here.
    unexplained
        The latent inputs that remain.
    """
    (causes, minor), required = judged, state.baseline.required
    unexplained = _not_by_noise(kept.fit, still_missing(kept.evidence, left, causes, required), causes, required)
    seen = (*causes, *minor)
    small = too_small(state, seen, unexplained)
    nuisance = [trial.candidate.attached for trial in minor_trials(state, seen)][:1]
    if small and (not unexplained or _nothing_left_with(kept, nuisance, state, causes, required)):
        minor, unexplained = (*minor, *small), []
    if not unexplained:
        unexplained = _missing_on_held(kept, nuisance, causes, required)
    return minor, unexplained


def beside_slow_noise(
    kept: Kept, state: State, causes: Sequence[Cause], minor: Sequence[Cause]
) -> tuple[tuple[Cause, ...], tuple[Cause, ...]]:
    """The named and the minor causes, after a test with slow noise.

    The noise of each reading, and the instrument offsets, are made as slow and as large as the residuals with all
    causes allow. A cause with too small a statistic under that noise becomes minor. This is backward elimination: the
    weakest cause is dropped and the others are tested again without it.
    """
    if not causes or kept.fit.noise.colour:
        return tuple(causes), tuple(minor)
    slow, left = as_slow_as_left(kept.fit), list(causes)
    while left and slow.noise.slow:
        gains = [(_share_of_required(slow, state, cause), i) for i, cause in enumerate(left)]
        share, weakest = min(gains)
        gate = at_least("gain where noise is slow, of that for a name", share, 1.0, "naming.gain")
        one = replace(left[weakest], gates=(*left[weakest].gates, gate))
        if gate.passed:
            left[weakest] = one
            break
        del left[weakest]
        minor = (*minor, noted(one, SLOW_NOISE))
        others = [a for a in slow.attached if a.effect.key != (one.kind, one.target, one.term)]
        slow = fit(slow.flight, others, slow.noise, slow)
    return tuple(left), tuple(minor)


def _share_of_required(slow: FlightFit, state: State, cause: Cause) -> float:
    """Likelihood-ratio statistic of a cause, from its standard deviation, over that required for a name.

    It is infinite for a cause that is not a parameter of the fit, such as turbulence.
    """
    slots = {slot.name for slot in slow.slots}
    for one in slow.attached:
        if one.effect.key == (cause.kind, cause.target, cause.term) and one.name in slots:
            return (slow[one.name] / slow.std(one.name)) ** 2 / required_gain(one.effect, state.criteria)
    return np.inf


def _not_by_noise(
    fitted: FlightFit,
    unexplained: list[MissingInput],
    causes: Sequence[Cause],
    required: float,
    share: float | None = None,
) -> list[MissingInput]:
    """The unexplained inputs that remain if the noise is as slow as the residuals of the fit.

    If slow noise is taken for white noise, each of its readings counts as new information, and a latent input has a
    statistic by mistake. In turbulence the innovations may instead be coloured; an input must remain in both cases.
    """
    if not unexplained or fitted.noise.colour:
        return unexplained
    for in_its_noise in (as_slow_as_left, *((as_coloured_as_left,) if fitted.noise.coloured else ())):
        evidence = weigh(in_its_noise(fitted))
        unexplained = still_missing(evidence, missing_inputs(evidence), causes, required, share)
        if not unexplained:
            break
    return unexplained


def _missing_on_held(
    kept: Kept, nuisance: Sequence[Attached], causes: Sequence[Cause], required: float
) -> list[MissingInput]:
    """Latent inputs that only the held-out records show.

    Neither the model nor other derivatives may explain them, nor a `nuisance` cause that is too small to matter in the
    fitted records.
    """

    def missing(model: FlightFit, held: FlightFit) -> list[MissingInput]:
        held = with_events(held, model)
        share = kept.evidence.criteria.held_out.missing_share
        evidence = weigh(fit(held.flight, held.attached, held.noise, held))
        found = still_missing(evidence, missing_inputs(evidence), causes, required, share)
        return _not_by_noise(evidence.fit, found, causes, required, share)

    found = missing(kept.fit, kept.held_fit)
    if found and nuisance:
        joint = kept.with_effects(nuisance)
        if not missing(joint, judge_on(kept.held_fit.flight.records, joint)):
            return []
    return found


def _nothing_left_with(
    kept: Kept, nuisance: Sequence[Attached], state: State, causes: Sequence[Cause], required: float
) -> bool:
    """Whether nothing is missing in the fitted records if `nuisance` causes are added to all that were named."""
    if not kept.has_all(state):
        return False
    evidence = weigh(kept.with_effects(nuisance))
    return not still_missing(evidence, missing_inputs(evidence), causes, required)
