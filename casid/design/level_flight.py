"""Experiments from level flight at the trim of an aircraft file: the limits that a flight-test engineer states."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Literal

import numpy as np

from casid.design.experiment import Experiment
from casid.design.separation import Rivals
from casid.errors import InputError
from casid.model.aircraft import Aircraft
from casid.model.dynamics import MOVING, aircraft_model
from casid.model.effect_value import EffectValue
from casid.model.effects import effect_of
from casid.model.terms import parse_term
from casid.model.trim import Trim, trim
from casid.model.vocabulary import KINDS

Plane = Literal["longitudinal", "lateral", "full"]
_ALONE: tuple[Plane, ...] = ("longitudinal", "lateral")


def _of_both(longitudinal: tuple[str, ...], lateral: tuple[str, ...]) -> Mapping[str, tuple[str, ...]]:
    """Return names by plane of motion; "full" has both."""
    return MappingProxyType({"longitudinal": longitudinal, "lateral": lateral, "full": (*longitudinal, *lateral)})


SURFACES = _of_both(("delta_e",), ("delta_a", "delta_r"))
OUTPUTS = _of_both(("V", "alpha", "q", "theta", "ax", "az"), ("beta", "p", "r", "phi", "ay"))
_COEFFICIENTS = _of_both(("CL", "CD", "CX", "CZ", "Cm"), ("CY", "Cl", "Cn"))
_REGRESSORS = _of_both(("alpha", "q", "delta_e"), ("beta", "p", "r", "delta_a", "delta_r"))
# 1-sigma of ordinary flight-test instruments, where the aircraft file names none
TYPICAL_NOISE: Mapping[str, float] = MappingProxyType(
    {"alpha": 0.003, "beta": 0.003, "p": 0.002, "q": 0.002, "r": 0.002, "phi": 0.005, "theta": 0.005}
    | {"ax": 0.1, "ay": 0.1, "az": 0.1, "V": 0.5}
)
_DT = 0.04  # s


@dataclass(frozen=True, kw_only=True)
class Limits:
    """Limits of a manoeuvre, as changes from trim: `surfaces` [rad], `channels` (SI); and its `duration` [s]."""

    surfaces: Mapping[str, float]
    channels: Mapping[str, float]
    duration: float


def experiment_of(
    aircraft: Aircraft,
    plane: Plane,
    limits: Limits,
    free: Sequence[str] = (),
    noise: Mapping[str, float] = MappingProxyType({}),
) -> Experiment:
    """Level flight at the trim of the file, within limits; `free` are globs of the derivatives to be estimated
    (default: all of the plane), `noise` 1-sigma by channel in place of the file's or typical ones. Raises InputError
    without a trim point."""
    level = level_values(level_flight(aircraft, "for a design"))
    model = aircraft_model(aircraft, axes=plane, outputs=OUTPUTS[plane], effects=())
    return Experiment(
        model=model,
        surfaces={name: limits.surfaces[name] for name in SURFACES[plane] if name in limits.surfaces},
        rest={name: level[name] for name in model.inputs},
        start=np.array([level[name] for name in model.states]),
        noise={o: noise.get(o) or aircraft.noise.get(o) or TYPICAL_NOISE[o] for o in OUTPUTS[plane]},
        duration=limits.duration,
        dt=_DT,
        parameters=free or [name for name in model.parameters if _is_of(plane, name)],
        limits={name: limit for name, limit in limits.channels.items() if name in OUTPUTS[plane]},
    )


def level_flight(aircraft: Aircraft, purpose: str) -> Trim:
    """Level flight at the [trim] of the file, without its effects. Raises InputError, with the `purpose` that needs it,
    where there is none."""
    V, altitude, rho = (aircraft.trim.get(name) for name in ("V", "altitude", "rho"))
    if V is None or (altitude is None and rho is None):
        raise InputError(f"'{aircraft.name}': [trim] needs V, and altitude or rho, {purpose}; add them to the file")
    return trim(aircraft, V=V, altitude=altitude, rho=rho)


def level_values(at: Trim) -> dict[str, float]:
    """Return states and inputs of an aircraft model by name."""
    return dict(zip(MOVING["full"], at.state.tolist(), strict=True)) | at.inputs


def _is_of(plane: Plane, name: str) -> bool:
    coefficient, _, regressor = name.partition("_")
    return coefficient in _COEFFICIENTS[plane] and regressor in _REGRESSORS[plane]


def plane_of(*names: str) -> Plane:
    """The plane of motion that surfaces, channels or coefficients are of; "full" where they are of both, or of none."""
    for plane in _ALONE:
        own = {*SURFACES[plane], *OUTPUTS[plane], *_COEFFICIENTS[plane], *_REGRESSORS[plane]}
        if names and own.issuperset(names):
            return plane
    return "full"


def level_rivals(
    aircraft: Aircraft,
    first: EffectValue,
    second: EffectValue,
    limits: Limits,
    noise: Mapping[str, float] = MappingProxyType({}),
) -> tuple[Rivals, Experiment]:
    """Two effects that compete in level flight, in the plane of motion of both, in place of those that the file has of
    their names. Raises InputError without a trim point, and for effects that no manoeuvre can bring about."""
    rivals = {effect_of(value).name for value in (first, second)}
    bare = replace(aircraft, effects=tuple(e for e in aircraft.effects if effect_of(e).name not in rivals))
    plane = plane_of(*(name for value in (first, second) for name in _named_by(value)))
    experiment = experiment_of(bare, plane, limits, noise=noise)
    own = Rivals(aircraft=bare, first=first, second=second, axes=plane, noise=experiment.noise)
    return own, experiment


def _named_by(value: EffectValue) -> tuple[str, ...]:
    """The surface, channel or coefficients that an effect is of, and the variables of its term."""
    variables = tuple(sorted(parse_term(value.term).variables)) if value.term else ()
    return (*KINDS[value.kind].parts(value.target), *variables)
