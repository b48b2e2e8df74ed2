"""Sets of the independent simulator: the only file that knows both `problems.independent` and casid.

It turns what that simulator recorded into flight records of casid, and what an engineer would know of the aircraft into
an aircraft file.
"""

from __future__ import annotations

from collections.abc import Mapping

from casid.errors import InputError
from casid.model.aircraft import Aircraft, Inertia
from casid.model.terms import parse_term
from casid.records.record import Record
from problems.blind.case import Answer, Hidden
from problems.independent.aircraft_file import UNCERTAINTY
from problems.independent.atmosphere import G0
from problems.independent.effects import CASES, Effect
from problems.independent.flights import Flown, fly_set

__all__ = ["CASES", "NAME", "aircraft_of", "flight", "records_of"]

NAME = "independent"


def flight(case: str, seed: int, size: float) -> tuple[tuple[Record, ...], Aircraft, Answer]:
    """Records, aircraft file and answer of a case and a seed; `size` is a factor on what is hidden.

    Raises InputError when no draw of that seed can be flown.
    """
    try:
        flown = fly_set(case, seed, size)
    except ValueError as error:
        raise InputError(str(error)) from None
    records = records_of(flown)
    answer = Answer(
        of=NAME,
        case=case,
        seed=seed,
        size=size,
        aircraft=flown.plane.name,
        hidden=() if flown.effect is None else (_hidden(flown.effect),),
        mismatch={name: float(f"{left:.3g}") for name, left in flown.fit.left.items()},
        conditions={
            "rate_hz": flown.plan.rate_hz,
            "noise": round(flown.plan.noise, 3),
            "durations_s": flown.plan.durations,
        },
        values={f"{c}_{_words(term)}": v for c, terms in flown.fit.values.items() for term, v in terms.items()},
    )
    return records, aircraft_of(flown), answer


def records_of(flown: Flown) -> tuple[Record, ...]:
    """What was recorded, as flight records of casid."""
    return tuple(
        Record(name=name, t=x["t"], channels={c: y for c, y in x.items() if c != "t"}, source="simulated")
        for name, x in flown.records.items()
    )


def aircraft_of(flown: Flown) -> Aircraft:
    """The aircraft file: exact mass properties and geometry, derivatives that are off."""
    plane, level = flown.plane, flown.level
    Ixx, Iyy, Izz, Ixz = plane.inertia
    values = {name: {_words(term): v for term, v in terms.items()} for name, terms in flown.derivatives.items()}
    products = {c: {t: v for t, v in terms.items() if parse_term(t).degree > 1} for c, terms in values.items()}
    first = {name: float(x[0]) for name, x in flown.records["m1"].items() if name in ("altitude", "rho")}
    return Aircraft(
        name=plane.name,
        mass=plane.mass,
        inertia=Inertia(Ixx=Ixx, Iyy=Iyy, Izz=Izz, Ixz=Ixz),
        gravity=G0,
        area=plane.area,
        moment_length_lateral=plane.span,
        moment_length_pitch=plane.chord,
        rate_length_lateral=plane.span / 2.0,
        rate_length_pitch=plane.chord / 2.0,
        thrust_line_z=plane.thrust_z,
        engine_y=plane.engine_y,
        trim={
            "V": plane.V,
            "alpha": float(f"{level.alpha[0]:.4g}"),
            "theta": float(f"{level.alpha[0]:.4g}"),
            "delta_e": float(f"{level.elevator[0]:.4g}"),
            **{name: float(f"{value:.5g}") for name, value in first.items()},
        },
        force_axes="wind",
        relative_uncertainty=UNCERTAINTY,
        derivatives={f"{c}_{t}": v for c, terms in values.items() for t, v in terms.items() if t not in products[c]},
        terms={c: terms for c, terms in products.items() if terms},
    )


def _words(term: tuple[str, ...]) -> str:
    return parse_term("*".join(term)).name if term else "0"


def _hidden(effect: Effect) -> Hidden:
    parameters: Mapping[str, float] = effect.parameters
    return Hidden(
        kind=effect.kind,
        target=effect.target,
        term=effect.term,
        value=effect.value,
        records=effect.records,
        onset_s=effect.onset_s,
        parameters=parameters,
    )
