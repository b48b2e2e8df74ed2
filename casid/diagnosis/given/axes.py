"""The axes that the records can support. Only these are estimated, and the others are reported as not judged."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from casid.diagnosis.criteria import GivenCriteria
from casid.diagnosis.given.not_judged import NotJudged
from casid.errors import unknown
from casid.model.aircraft import Aircraft
from casid.model.applied import axes_of
from casid.model.dynamics import MOVING, has_aerodynamics, moved_coefficients
from casid.records.record import Record

_SURFACES: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {"longitudinal": ("delta_e",), "lateral": ("delta_a", "delta_r")}
)
_FLOW_ANGLE: Mapping[str, str] = MappingProxyType({"longitudinal": "alpha", "lateral": "beta"})
_RATES: Mapping[str, tuple[str, ...]] = MappingProxyType({"longitudinal": ("q",), "lateral": ("p", "r")})
_OTHER: Mapping[str, str] = MappingProxyType({"longitudinal": "lateral", "lateral": "longitudinal"})


@dataclass(frozen=True, kw_only=True)
class Axes:
    """The scope, "full", "longitudinal" or "lateral", and what it leaves open."""

    name: str
    not_judged: tuple[NotJudged, ...] = ()


def axes_that_tell(
    records: Sequence[Record],
    wanted: str | None = None,
    criteria: GivenCriteria | None = None,
    aircraft: Aircraft | None = None,
) -> Axes:
    """The axes that the records can support, or those that are `wanted`.

    If surfaces and flow angle of an axis move little compared with the other axis, couplings and turbulence contribute
    as much to its motion as its surfaces do, and the axis is left out. An axis without aerodynamics in the `aircraft`
    file is left out as well.

    Raises InputError for unknown axes, and if no surface drives the model.
    """
    if wanted is not None and wanted not in MOVING:
        raise unknown("axes", wanted, MOVING)
    fed = axes_of(records)
    still = (criteria or GivenCriteria()).still
    if wanted is not None:
        left_out = _motions(_OTHER.get(wanted), f"{wanted} axes were asked for")
        if wanted in _OTHER and fed == "full" and (share := _share(records, wanted, _OTHER[wanted])) < still:
            what, because = f"what moves the {wanted} motion", _rests(records, wanted, share)
            left_out = (*left_out, NotJudged(what=what, because=f"{because}: small couplings make as much of it"))
        return Axes(name=wanted, not_judged=left_out)
    if fed != "full":
        missing = [s for s in _SURFACES[_OTHER[fed]] if not all(s in record for record in records)]
        return Axes(name=fed, not_judged=_motions(_OTHER[fed], f"no channel {' and '.join(missing)}"))
    for absent, modelled in _OTHER.items():
        if aircraft is not None and has_aerodynamics(aircraft, modelled) and not has_aerodynamics(aircraft, absent):
            coefficients = ", ".join(moved_coefficients(aircraft, absent))
            return Axes(name=modelled, not_judged=_motions(absent, f"the aircraft file has nothing of {coefficients}"))
    for resting, moving in _OTHER.items():
        share = _share(records, resting, moving)
        if share < still:
            return Axes(name=moving, not_judged=_motions(resting, _rests(records, resting, share)))
    return Axes(name="full")


def _rests(records: Sequence[Record], resting: str, share: float) -> str:
    """The reason for leaving out an axis that moves too little."""
    angles = all(any(name in record for record in records) for name in _FLOW_ANGLE.values())
    who = [*_SURFACES[resting], *((_FLOW_ANGLE[resting],) if angles else _RATES[resting])]
    return f"{' and '.join(who)} move {100.0 * share:.0f} % of what the {_OTHER[resting]} ones do"


def _motions(axis: str | None, because: str) -> tuple[NotJudged, ...]:
    return (NotJudged(what=f"{axis} motion", because=because),) if axis else ()


def _share(records: Sequence[Record], resting: str, moving: str) -> float:
    """Motion of an axis over that of the other: surfaces or flow angles, whichever is larger; rates if a flow angle is
    not measured. Infinite if these are not measured either, or if the other axis does not move.
    """
    surfaces, angles, rates = (
        [max(_excursion(records, name) for name in names[axis]) for axis in (resting, moving)]
        for names in (_SURFACES, {axis: (name,) for axis, name in _FLOW_ANGLE.items()}, _RATES)
    )
    motion = angles if np.all(np.isfinite(angles)) else rates
    if not (surfaces[1] > 0.0 and motion[1] > 0.0 and np.isfinite(motion[0])):
        return np.inf
    return max(surfaces[0] / surfaces[1], motion[0] / motion[1])


def _excursion(records: Sequence[Record], name: str) -> float:
    """Largest excursion from the median of a record; NaN where no record has the channel."""
    found = [record[name] for record in records if name in record and np.isfinite(record[name]).any()]
    return max((float(np.nanmax(np.abs(x - np.nanmedian(x)))) for x in found), default=float("nan"))
