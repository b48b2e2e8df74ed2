"""Which pictures the report shows, and which one comes first."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace

from casid.diagnosis.cause import Cause
from casid.diagnosis.result import Diagnosis
from casid.model.effects import effect_of
from casid.report.bars import kinematic, ladder, missing
from casid.report.budget_figures import budget
from casid.report.cause_response import cause_response
from casid.report.check_figures import check_figure
from casid.report.claims import numbered
from casid.report.derivatives import derivatives
from casid.report.envelope import envelope
from casid.report.heatmap import ambiguity, heatmap
from casid.report.onset import onset
from casid.report.reconstruction import Reconstruction, reconstruct
from casid.report.residuals import gain, histories, residuals
from casid.report.shape import missing_history, shape, wind
from casid.report.style import Picture, settings
from casid.report.tracks import PLANES, tracks

_MOST = 3  # causes, and places where something is unexplained, that have pictures of their own


def pictures(diagnosis: Diagnosis) -> dict[str, Picture]:
    """Name -> picture; the one most convincing for this verdict comes first and is not repeated."""
    seen = reconstruct(diagnosis)
    with settings():
        further = [
            *_of_causes(diagnosis, seen),
            *_of_the_unexplained(diagnosis),
            budget(diagnosis.budget),
            gain(diagnosis),
            *tracks(diagnosis),
            histories(diagnosis),
            residuals(diagnosis),
            heatmap(diagnosis),
            ladder(diagnosis),
            ambiguity(diagnosis),
            missing(diagnosis, seen),
            kinematic(diagnosis),
            check_figure(diagnosis.data, *_before_and_after(diagnosis)),
            derivatives(diagnosis),
            envelope(diagnosis),
        ]
    table = {picture.name: picture for picture in further if picture is not None}
    lead = _lead(diagnosis, table)
    return {lead: table.pop(lead)} | table


def _lead(diagnosis: Diagnosis, table: dict[str, Picture]) -> str:
    """Name of the picture that comes first: the channels in engineering units, of the plane in which the error as given
    is largest."""
    channels = diagnosis.budget.channels
    error = {
        f"tracks_{plane}": max((channels[name].as_given for name in names if name in channels), default=0.0)
        for plane, (_, names) in PLANES.items()
    }
    return max((name for name in error if name in table), key=lambda name: error[name], default="histories")


def _of_causes(diagnosis: Diagnosis, seen: Reconstruction) -> Iterator[Picture]:
    """Pictures of the strongest causes, each named with the number of its cause."""
    for number, cause in enumerate(diagnosis.causes[:_MOST], 1):
        for picture in _of_cause(diagnosis, cause, seen):
            if picture is not None:
                yield replace(picture, name=numbered(picture.name, number))


def _of_cause(diagnosis: Diagnosis, cause: Cause, seen: Reconstruction) -> Iterable[Picture | None]:
    if effect_of(cause).stochastic:
        yield wind(diagnosis)
        return
    yield shape(diagnosis, cause, seen.before)
    yield onset(diagnosis, cause)
    yield cause_response(diagnosis, cause)
    found = seen.before.get(effect_of(cause).enters or "")
    yield missing_history(diagnosis, found, curve=True) if found is not None else None


def _of_the_unexplained(diagnosis: Diagnosis) -> Iterator[Picture]:
    for number, one in enumerate(diagnosis.unexplained[:_MOST], 1):
        yield missing_history(diagnosis, one, curve=False, name=numbered("unexplained", number))


def _before_and_after(diagnosis: Diagnosis):
    """Records as they were recorded, and as they were judged."""
    recorded = (*diagnosis.as_given.fit.flight.records, *diagnosis.held_out_as_given.fit.flight.records)
    judged = (*diagnosis.refitted.fit.flight.records, *diagnosis.held_out_refitted.fit.flight.records)
    return recorded, judged
