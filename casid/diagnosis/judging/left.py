"""What is left when causes are named: inputs that are missing, unless causes too small to matter explain them."""

from __future__ import annotations

from collections.abc import Sequence

from casid.diagnosis.cause import Cause
from casid.diagnosis.evidence.evidence import weigh
from casid.diagnosis.evidence.missing_input import MissingInput, missing_inputs
from casid.diagnosis.flight.colour import as_coloured_as_left
from casid.diagnosis.flight.evaluation import FlightFit
from casid.diagnosis.flight.fit import fit
from casid.diagnosis.flight.hypothesis import Attached
from casid.diagnosis.judging.held_out import judge_on, with_events
from casid.diagnosis.judging.kept import Kept
from casid.diagnosis.judging.verdict import minor_trials, still_missing, too_small
from casid.diagnosis.naming.naming import Naming


def what_is_left(
    kept: Kept,
    naming: Naming,
    left: Sequence[MissingInput],
    judged: tuple[tuple[Cause, ...], tuple[Cause, ...]],
    required: float,
) -> tuple[tuple[Cause, ...], list[MissingInput]]:
    """(minor, unexplained): what no cause explains, unless causes do that are too small to matter.

    left      inputs that are missing in the fitted records
    judged    causes and minor ones
    required  gain that a missing input must exceed where the air is turbulent
    """
    causes, minor = judged
    unexplained = _not_by_noise(kept.fit, still_missing(kept.evidence, left, causes, required), causes, required)
    seen = (*causes, *minor)
    small = too_small(naming, seen, unexplained)
    nuisance = [trial.candidate.attached for trial in minor_trials(naming, seen)][:1]
    if small and (not unexplained or _nothing_left_with(kept, nuisance, naming, causes, required)):
        minor, unexplained = (*minor, *small), []
    if not unexplained:
        unexplained = _missing_on_held(kept, nuisance, causes, required)
    return minor, unexplained


def _not_by_noise(
    fitted: FlightFit,
    unexplained: list[MissingInput],
    causes: Sequence[Cause],
    required: float,
    share: float | None = None,
) -> list[MissingInput]:
    """What of the unexplained is missing still where noise is as slow as the fit leaves it. Read as white, each reading
    of slow noise counts as news, and an unknown input gains by it."""
    if not unexplained or fitted.noise.colour:
        return unexplained
    coloured = weigh(as_coloured_as_left(fitted))
    return still_missing(coloured, missing_inputs(coloured), causes, required, share)


def _missing_on_held(
    kept: Kept, nuisance: Sequence[Attached], causes: Sequence[Cause], required: float
) -> list[MissingInput]:
    """What only the held-out records show: neither the model nor other derivatives explain it, nor a `nuisance` cause,
    which is too small to matter in the fitted ones."""

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
    kept: Kept, nuisance: Sequence[Attached], naming: Naming, causes: Sequence[Cause], required: float
) -> bool:
    """Whether nothing is missing in the fitted records once a `nuisance` cause stands beside all that were named."""
    if not kept.has_all(naming):
        return False
    evidence = weigh(kept.with_effects(nuisance))
    return not still_missing(evidence, missing_inputs(evidence), causes, required)
