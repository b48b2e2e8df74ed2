"""An aircraft with its effects taken into its numbers, as far as derivatives, mass and inertia can hold them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from casid.errors import InputError
from casid.formats.file_tables import said
from casid.model.aircraft import Aircraft
from casid.model.effects import effect_of
from casid.model.terms import derivative_term, parse_term
from casid.model.trim import trim

RATE_OF = {"CY": "betadot", "Cl": "betadot", "Cn": "betadot"}  # of the flow angle that unsteady aerodynamics are of
_RANGE = 0.1  # rad about the trim, in which a parabola replaces the drag of a file
_ROUNDING = 1e-12
_POWERS = ("0", "alpha", "alpha^2", "alpha^3")


@dataclass(frozen=True, eq=False, kw_only=True)
class Absorbed:
    """Content of a target: aircraft, its terms, and what no number of it holds."""

    aircraft: Aircraft  # without effects
    # coefficient -> canonical monomial ("0" for the constant) -> value, of all that is not zero
    rows: Mapping[str, Mapping[str, float]]
    left: tuple[str, ...]  # effects that no number of an aircraft holds, a line each

    def value(self, coefficient: str, term: str) -> float:
        """Return the value of a term; zero where the file has none."""
        return self.rows.get(coefficient, {}).get(term, 0.0)

    def beyond(self, held: Mapping[str, Sequence[str]]) -> list[str]:
        """Terms that a target does not hold, a line each; `held`: coefficient -> monomials that it does."""
        return [
            f"{coefficient}: {value:.6g} times {term}"
            for coefficient, row in self.rows.items()
            for term, value in row.items()
            if term not in held.get(coefficient, ())
        ]


def terms_of(aircraft: Aircraft) -> Iterator[tuple[str, str, float]]:
    """(coefficient, canonical term, value) of every derivative and further term of an aircraft."""
    for name, value in aircraft.derivatives.items():
        coefficient, term = derivative_term(name)
        yield coefficient, term.name, value
    for coefficient, terms in aircraft.terms.items():
        yield from ((coefficient, term, value) for term, value in terms.items())


def absorbed(aircraft: Aircraft) -> Absorbed:
    """Mass, inertia and aerodynamic terms among the effects become numbers of the aircraft; the others are left."""
    mass = aircraft.mass
    inertia = {n: getattr(aircraft.inertia, n) for n in ("Ixx", "Iyy", "Izz", "Ixz")}
    rows: dict[str, dict[str, float]] = {}
    for coefficient, term, value in terms_of(aircraft):
        add_term(rows, coefficient, term, value)
    left: list[str] = []
    rotors = aircraft.rotors
    # where hover is, is asked of the mass: effects of loading first
    for effect in sorted(aircraft.effects, key=lambda one: one.kind not in ("mass", "inertia")):
        if effect.records or effect.onset_s:
            left.append(said(effect, "is not in all records, or not always"))
        elif effect.kind == "aero_term" and effect.term:
            add_term(rows, effect.target, parse_term(effect.term).name, effect.value)
        elif effect.kind == "unsteady_aero" and not effect.parameters:
            add_term(rows, effect.target, RATE_OF.get(effect.target, "alphadot"), effect.value)
        elif effect.kind == "mass":
            mass += effect.value
        elif effect.kind == "inertia":
            inertia[effect.target] += effect.value
        else:
            make = effect_of(effect).forms.into_rotors
            held = make(rotors, mass * aircraft.gravity, effect.value) if make and rotors is not None else None
            rotors = held or rotors
            if held is None:
                left.append(said(effect, "is no number of an aircraft"))
    kept = {c: {t: v for t, v in row.items() if v != 0.0} for c, row in rows.items()}
    bare = replace(aircraft, mass=mass, inertia=replace(aircraft.inertia, **inertia), rotors=rotors, effects=())
    return Absorbed(aircraft=bare, rows={c: row for c, row in kept.items() if row}, left=tuple(left))


def need_derivatives(aircraft: Aircraft, target: str) -> None:
    """Raise InputError unless the aerodynamics are derivatives and terms, which `target` needs."""
    if aircraft.tables or aircraft.aerodynamics is not None:
        what = "tables" if aircraft.tables else "aerodynamics of their own"
        raise InputError(
            f"'{aircraft.name}': its aerodynamics are {what}, and {target} holds derivatives alone; estimate "
            "derivatives about a flight point first, or export to matlab"
        )


def in_wind_axes(plain: Absorbed) -> Absorbed:
    """Lift and drag in place of CX and CZ, by their series about the trim: lift to first order in the angle of attack,
    drag to second, everything else as it acts there. A line in `left` states how far that departs. Files in wind axes
    are left alone."""
    if plain.aircraft.force_axes == "wind":
        return plain
    at = _trim_alpha(plain.aircraft)
    s = np.sin(at)
    c = np.cos(at)
    X, Z = (np.polynomial.Polynomial([plain.value(name, term) for term in _POWERS]) for name in ("CX", "CZ"))
    (x, dx, ddx), (z, dz, ddz) = ([float(one(at)), float(one.deriv()(at)), float(one.deriv(2)(at))] for one in (X, Z))
    lift = x * s - z * c
    lift_slope = dx * s + x * c - dz * c + z * s
    drag = -x * c - z * s
    drag_slope = -dx * c + x * s - dz * s - z * c
    bend = 0.5 * (-ddx * c + 2.0 * dx * s + x * c - ddz * s - 2.0 * dz * c + z * s)
    rows = {name: dict(row) for name, row in plain.rows.items() if name not in ("CX", "CZ")}
    rows["CL"] = {"0": lift - lift_slope * at, "alpha": lift_slope}
    rows["CD"] = {"0": drag - drag_slope * at + bend * at**2, "alpha": drag_slope - 2.0 * bend * at, "alpha^2": bend}
    for term in {**plain.rows.get("CX", {}), **plain.rows.get("CZ", {})}:
        if term not in _POWERS:
            along = plain.value("CX", term)
            down = plain.value("CZ", term)
            rows["CL"][term] = along * s - down * c
            rows["CD"][term] = -along * c - down * s
    kept = {name: {term: v for term, v in row.items() if v != 0.0} for name, row in rows.items()}
    alpha = at + np.linspace(-_RANGE, _RANGE, 41)
    off = np.abs(X(alpha) * np.sin(alpha) - Z(alpha) * np.cos(alpha) - lift - lift_slope * (alpha - at)).max()
    note = (
        f"CX and CZ: as lift and drag about alpha = {at:.4f} rad; lift up to {off:.2g} off within {_RANGE:g} rad of it"
    )
    return replace(plain, rows=kept, left=(*plain.left, note))


@dataclass(frozen=True, kw_only=True)
class Polar:
    """CD = parasitic + factor CL^2, CL that of the angle of attack alone; `note` states where it departs from the file,
    "" where it does not."""

    parasitic: float
    factor: float
    note: str


def polar_of(plain: Absorbed) -> Polar:
    """The drag polar of a file: value and slope of its drag at the trim. Raises InputError without a lift slope."""
    powers = [plain.value("CD", term) for term in _POWERS]
    lift = [plain.value("CL", term) for term in ("0", "alpha")]
    if lift[1] == 0.0:
        raise InputError(f"'{plain.aircraft.name}': CL_alpha is zero or missing, so that there is no drag polar")
    drag = np.polynomial.Polynomial(powers)
    CL = np.polynomial.Polynomial(lift)
    at = _trim_alpha(plain.aircraft)
    if abs(CL(at)) < _ROUNDING:
        at += _RANGE  # without lift, no slope of the drag shows how it grows with lift
    factor = float(drag.deriv()(at)) / (2.0 * float(CL(at)) * lift[1])
    parasitic = float(drag(at)) - factor * float(CL(at)) ** 2
    alpha = at + np.linspace(-_RANGE, _RANGE, 41)
    off = float(np.abs(drag(alpha) - parasitic - factor * CL(alpha) ** 2).max())
    note = f"CD by alpha: value and slope at alpha = {at:.4f} rad; within {_RANGE:g} rad of it up to {off:.2g} off"
    return Polar(parasitic=parasitic, factor=factor, note="" if off <= 1e-9 * max(1.0, abs(parasitic)) else note)


def _trim_alpha(aircraft: Aircraft) -> float:
    """Angle of attack of [trim], or of the trim that can be computed, or zero."""
    if "alpha" in aircraft.trim:
        return aircraft.trim["alpha"]
    V, rho, altitude = (aircraft.trim.get(name) for name in ("V", "rho", "altitude"))
    if V is None or (rho is None and altitude is None):
        return 0.0
    try:
        return trim(aircraft, V=V, rho=rho, altitude=altitude if rho is None else None).alpha
    except InputError:
        return 0.0


def add_term(rows: dict[str, dict[str, float]], coefficient: str, term: str, value: float) -> None:
    """Add a value to a term of a coefficient."""
    row = rows.setdefault(coefficient, {})
    row[term] = row.get(term, 0.0) + value
