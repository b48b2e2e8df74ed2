"""Which pictures the report shows, and which one comes first."""

from __future__ import annotations

from collections.abc import Iterable

from casid.diagnosis.cause import Cause
from casid.diagnosis.evidence.missing_input import MissingInput
from casid.diagnosis.result import Diagnosis
from casid.model.effects import effect_of
from casid.model.station import Station
from casid.report.bars import kinematic, ladder, missing
from casid.report.budget_figures import budget
from casid.report.heatmap import ambiguity, heatmap
from casid.report.onset import onset
from casid.report.reconstruction import Reconstruction, reconstruct
from casid.report.residuals import gain, histories, residuals
from casid.report.shape import missing_history, shape, wind
from casid.report.style import Picture, settings


def pictures(diagnosis: Diagnosis) -> dict[str, Picture]:
    """Name -> picture; the one most convincing for this verdict comes first and is not repeated."""
    seen = reconstruct(diagnosis)
    with settings():
        lead = _lead(diagnosis, seen)
        further = [
            budget(diagnosis.budget),
            gain(diagnosis),
            *_further(diagnosis, seen),
            histories(diagnosis),
            residuals(diagnosis),
            heatmap(diagnosis),
            ladder(diagnosis),
            ambiguity(diagnosis),
            missing(diagnosis, seen),
            kinematic(diagnosis),
        ]
    table = {lead.name: lead}
    for picture in further:
        if picture is not None:
            table.setdefault(picture.name, picture)
    return table


def _lead(diagnosis: Diagnosis, seen: Reconstruction) -> Picture:
    for cause in diagnosis.causes[:1]:
        effect = effect_of(cause)
        if effect.stochastic:
            return wind(diagnosis)
        choice = [shape(diagnosis, cause, seen.before), onset(diagnosis, cause)]
        if effect.enters is not None and Station.at(effect.enters).kind == "wind":
            choice.insert(0, _history_of(diagnosis, cause, seen))
        return next((picture for picture in choice if picture is not None), residuals(diagnosis))
    unexplained = _unexplained(diagnosis)
    if unexplained is not None:
        return missing_history(diagnosis, unexplained, curve=False)
    return histories(diagnosis) or residuals(diagnosis)


def _further(diagnosis: Diagnosis, seen: Reconstruction) -> Iterable[Picture | None]:
    """Pictures of the strongest cause that are not the first one, and of what stays unexplained."""
    for cause in diagnosis.causes[:1]:
        yield _history_of(diagnosis, cause, seen)
        yield onset(diagnosis, cause)
    unexplained = _unexplained(diagnosis)
    if diagnosis.causes and unexplained is not None:
        yield missing_history(diagnosis, unexplained, curve=False, name="still_missing")


def _history_of(diagnosis: Diagnosis, cause: Cause, seen: Reconstruction) -> Picture | None:
    found = seen.before.get(effect_of(cause).enters or "")
    return missing_history(diagnosis, found, curve=True) if found is not None else None


def _unexplained(diagnosis: Diagnosis) -> MissingInput | None:
    left = diagnosis.unexplained
    return left[0] if left else None
