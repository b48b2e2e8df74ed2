"""Anonymous inputs for the eye: what is missing at each place, with the structure of the model taken as exact.

The verdict rests on `Diagnosis.missing_before` and `missing_after`, in which small further terms are free to explain
what they can; such terms would also swallow the shape that a person is to see.
"""

from __future__ import annotations

from dataclasses import dataclass

from casid.diagnosis.evidence import weigh
from casid.diagnosis.missing_input import MissingInput, missing_inputs
from casid.diagnosis.result import Diagnosis


@dataclass(frozen=True, eq=False, kw_only=True)
class Reconstruction:
    """Station -> what an unknown input there would be, by today's model and by the extended one."""

    before: dict[str, MissingInput]
    after: dict[str, MissingInput]


def reconstruct(diagnosis: Diagnosis) -> Reconstruction:
    """Both sets of anonymous inputs; one and the same when nothing was added."""
    old, new = diagnosis.baseline.fit, diagnosis.extended.fit
    before = _by_station(missing_inputs(weigh(old, discrepancy=False)))
    after = before if new is old else _by_station(missing_inputs(weigh(new, discrepancy=False)))
    return Reconstruction(before=before, after=after)


def _by_station(found: list[MissingInput]) -> dict[str, MissingInput]:
    return {one.station: one for one in found}
