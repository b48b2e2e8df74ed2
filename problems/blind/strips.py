"""Sets of the aircraft of strips: the only file that knows both `problems.strips` and casid."""

from __future__ import annotations

from casid.errors import InputError
from casid.model.aircraft import Aircraft, Inertia
from casid.model.terms import parse_term
from casid.records.record import Record
from problems.blind.case import Answer, Hidden
from problems.independent.atmosphere import G0
from problems.strips.effects import CASES, Effect
from problems.strips.flights import UNCERTAINTY, Flown, fly_set

__all__ = ["CASES", "NAME", "aircraft_of", "flight", "records_of"]

NAME = "strips"


def flight(case: str, seed: int) -> tuple[tuple[Record, ...], Aircraft, Answer]:
    """Records, aircraft file and answer of a case and a seed. InputError when no draw of that seed can be flown."""
    try:
        flown = fly_set(case, seed)
    except ValueError as error:
        raise InputError(str(error)) from None
    answer = Answer(
        of=NAME,
        case=case,
        seed=seed,
        size=1.0,
        aircraft=flown.plane.name,
        hidden=tuple(_hidden(one) for one in flown.effects),
        mismatch=flown.left,
        conditions=flown.conditions,
        values=flown.values,
        besides=_besides(flown),
    )
    return records_of(flown), aircraft_of(flown), answer


def records_of(flown: Flown) -> tuple[Record, ...]:
    """What was recorded, as flight records of casid."""
    return tuple(
        Record(name=name, t=x["t"], channels={c: y for c, y in x.items() if c != "t"}, source="simulated")
        for name, x in flown.records.items()
    )


def aircraft_of(flown: Flown) -> Aircraft:
    """The aircraft file: exact mass properties and geometry, derivatives with their stated errors."""
    plane, level = flown.plane, flown.level
    Ixx, Iyy, Izz, Ixz = plane.inertia
    span, chord = plane.wing[:2]
    return Aircraft(
        name=plane.name,
        mass=plane.mass,
        inertia=Inertia(Ixx=Ixx, Iyy=Iyy, Izz=Izz, Ixz=Ixz),
        gravity=G0,
        area=plane.area,
        moment_length_lateral=span,
        moment_length_pitch=chord,
        rate_length_lateral=span / 2.0,
        rate_length_pitch=chord / 2.0,
        thrust_line_z=plane.thrust_z,
        engine_y=plane.propellers or (0.0,),
        trim={
            "V": plane.V,
            "alpha": float(f"{level.alpha:.4g}"),
            "theta": float(f"{level.alpha:.4g}"),
            "delta_e": float(f"{level.surface[0]:.4g}"),
            "altitude": plane.altitude,
            "rho": float(f"{flown.records['m1']['rho'][0]:.5g}"),
        },
        force_axes="wind",
        relative_uncertainty=UNCERTAINTY,
        derivatives=dict(flown.given),
    )


def _besides(flown: Flown) -> tuple[Hidden, ...]:
    """What is true of strips beside what was hidden: weather, and the terms that a linear file lacks."""
    terms = []
    # What stands in the slipstream of a propeller, whose thrust hardly varies apart from speed.
    slipstream = (("CD", "Tc"), ("Cm", "Tc"), ("Cm", "delta_e*Tc"), ("Cn", "Tc"), ("Cn", "delta_r*Tc"))
    for coefficient, term in (*flown.curved, *(slipstream if flown.plane.propellers else ())):
        if term.endswith("dot"):
            terms.append(Hidden(kind="unsteady_aero", target=coefficient, value=0.0))
        terms.append(Hidden(kind="aero_term", target=coefficient, term=parse_term(term).name, value=0.0))
    weather = () if flown.conditions["air"] == "calm" else (Hidden(kind="turbulence", value=0.0),)
    return (*weather, *terms)


def _hidden(effect: Effect) -> Hidden:
    return Hidden(
        kind=effect.kind,
        target=effect.target,
        term=effect.term,
        value=effect.value,
        records=effect.records,
        onset_s=effect.onset_s,
        parameters=effect.parameters,
    )
