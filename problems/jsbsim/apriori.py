"""What an engineer would know beforehand of a JSBSim aircraft: mass, geometry, trim, derivatives that are not exact.

The derivatives are regressed on noise-free flights of the healthy aircraft and then perturbed by 10 to 20 per cent:
a-priori values are not the truth.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from casid.model.aircraft import Aircraft, Inertia
from casid.model.terms import parse_term
from casid.records.record import Record
from problems.jsbsim.airframe import airframe
from problems.jsbsim.fdm import Log
from problems.jsbsim.flight import Flight, log_of, record_of
from problems.jsbsim.manoeuvres import CARDS

RELATIVE_UNCERTAINTY = 0.3
_LATERAL = ("0", "beta", "p", "r", "delta_a", "delta_r")
# drag in stability axes has the products that side force in wind axes and induced drag leave there
STRUCTURE: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "CL": ("0", "alpha", "q", "delta_e"),
        "CD": ("0", "alpha", "delta_e", "alpha^2", "beta^2", "delta_e^2", "beta*delta_r"),
        "CY": _LATERAL,
        "Cl": _LATERAL,
        "Cm": ("0", "alpha", "q", "delta_e"),
        "Cn": _LATERAL,
    }
)
_NEGLIGIBLE = 0.005  # share of the coefficient's variation below which a term is left out of the aircraft file

_NO_CONSTANT = 2e-4


@dataclass(frozen=True, kw_only=True)
class Regression:
    """Coefficient -> term -> value, and coefficient -> share of its variance that the terms explain."""

    values: Mapping[str, Mapping[str, float]]
    R2: Mapping[str, float]


def aircraft_file(name: str, seed: int) -> Aircraft:
    """The aircraft file of an airframe: flown mass properties, trim, perturbed derivatives. Needs jsbsim.

    seed   of the perturbation of the derivatives
    """
    pairs = healthy_flights(name)
    log, record = pairs[0]
    bare = geometry(airframe(name).name, log, record)
    return guessed(bare, regress(bare, [record for _, record in pairs]), seed)


def guessed(bare: Aircraft, found: Regression, seed: int, off: tuple[float, float] = (0.1, 0.2)) -> Aircraft:
    """The aircraft with regressed derivatives and terms, each `off` by a fraction between the two, up or down."""
    rng = np.random.default_rng(seed)
    values = {
        coefficient: {term: _guess(term, value, rng, off) for term, value in terms.items()}
        for coefficient, terms in found.values.items()
    }
    products = {c: {t: v for t, v in terms.items() if _is_product(t)} for c, terms in values.items()}
    return replace(
        bare,
        derivatives={f"{c}_{t}": v for c, terms in values.items() for t, v in terms.items() if not _is_product(t)},
        terms={c: terms for c, terms in products.items() if terms},
    )


def healthy_flights(name: str) -> list[tuple[Log, Record]]:
    """Noise-free flights of the healthy aircraft, one per manoeuvre."""
    flights = [Flight(aircraft=name, manoeuvre=card, noise={}, seed=0) for card in CARDS]
    logs = [log_of(flight) for flight in flights]
    return [(log, record_of(flight, log)) for flight, log in zip(flights, logs, strict=True)]


def geometry(name: str, log: Log, record: Record) -> Aircraft:
    """Aircraft whose aerodynamics are all zero: mass properties, reference lengths and trim of a flight."""
    J = log.inertia
    first = {key: float(record[key][0]) for key in ("V", "altitude", "rho", "alpha", "theta", "delta_e", "thrust")}
    return Aircraft(
        name=name,
        mass=round(log.mass, 2),
        inertia=Inertia(
            Ixx=round(J[0, 0], 1), Iyy=round(J[1, 1], 1), Izz=round(J[2, 2], 1), Ixz=round(-J[0, 2], 1) + 0.0
        ),
        gravity=round(log.gravity, 5),
        area=round(log.area, 5),
        moment_length_lateral=round(log.span, 5),
        moment_length_pitch=round(log.chord, 5),
        rate_length_lateral=round(log.span / 2.0, 6),
        rate_length_pitch=round(log.chord / 2.0, 6),
        thrust_line_z=round(log.thrust_line_z, 4),
        engine_y=tuple(round(y, 4) for y in log.engine_y),
        trim={key: float(f"{value:.5g}") for key, value in first.items()},
        force_axes="wind",
        relative_uncertainty=RELATIVE_UNCERTAINTY,
        derivatives={f"{coefficient}_0": 0.0 for coefficient in STRUCTURE},
    )


def regress(
    aircraft: Aircraft, records: Iterable[Record], structure: Mapping[str, Sequence[str]] = STRUCTURE
) -> Regression:
    """Least squares of `structure` on the coefficients that the records' accelerations give (paper eq. 6-9)."""
    records = list(records)
    regressors = [regressors_of(aircraft, record) for record in records]
    measured = [coefficients(aircraft, record) for record in records]
    values, R2 = {}, {}
    for coefficient, terms in structure.items():
        y = np.concatenate([m[coefficient] for m in measured])
        A = np.concatenate([np.stack([_column(r, t) for t in terms], axis=1) for r in regressors])
        theta = np.linalg.lstsq(A, y, rcond=None)[0]
        matters = np.std(A, axis=0) * np.abs(theta) > _NEGLIGIBLE * np.std(y)
        matters |= np.array([t == "0" for t in terms])
        theta = np.linalg.lstsq(A[:, matters], y, rcond=None)[0]
        kept = [t for t, m in zip(terms, matters, strict=True) if m]
        values[coefficient] = dict(zip(kept, theta.tolist(), strict=True))
        R2[coefficient] = float(1.0 - np.var(y - A[:, matters] @ theta) / np.var(y))
    return Regression(values=values, R2=R2)


def coefficients(aircraft: Aircraft, record: Record) -> dict[str, np.ndarray]:
    """CL CD (stability axes) CY (body) Cl Cm Cn, (N,) each, from the accelerations of a record (paper eq. 6, 7)."""
    qS = 0.5 * record["rho"] * record["V"] ** 2 * aircraft.area
    X = aircraft.mass * record["ax"] - record["thrust"]
    Z = aircraft.mass * record["az"]
    sin_a, cos_a = np.sin(record["alpha"]), np.cos(record["alpha"])
    inertia = aircraft.inertia
    J = np.array([[inertia.Ixx, 0.0, -inertia.Ixz], [0.0, inertia.Iyy, 0.0], [-inertia.Ixz, 0.0, inertia.Izz]])
    omega = record.matrix(("p", "q", "r"))
    L, M, N = (record.matrix(("pdot", "qdot", "rdot")) @ J + np.cross(omega, omega @ J)).T
    return {
        "CL": (X * sin_a - Z * cos_a) / qS,
        "CD": -(X * cos_a + Z * sin_a) / qS,
        "CY": aircraft.mass * record["ay"] / qS,
        "Cl": L / (qS * aircraft.moment_length_lateral),
        "Cm": (M - aircraft.thrust_line_z * record["thrust"]) / (qS * aircraft.moment_length_pitch),
        "Cn": N / (qS * aircraft.moment_length_lateral),
    }


def regressors_of(aircraft: Aircraft, record: Record) -> dict[str, np.ndarray]:
    """Variables of the aircraft file's terms along a record, (N,) each; rates dimensionless."""
    V = record["V"]
    rates = {name: record[name] * aircraft.rate_length_lateral / V for name in ("p", "r")}
    pitch = {"q": record["q"] * aircraft.rate_length_pitch / V}
    return rates | pitch | {n: record[n] for n in ("alpha", "beta", "delta_e", "delta_a", "delta_r")}


def _column(regressors: Mapping[str, np.ndarray], term: str) -> np.ndarray:
    return parse_term(term).evaluate(regressors) * np.ones_like(regressors["alpha"])


def _is_product(term: str) -> bool:
    return parse_term(term).degree > 1


def _guess(term: str, value: float, rng: np.random.Generator, off: tuple[float, float]) -> float:
    """`off` by a fraction, three significant digits; a constant that is nothing but trim error is zero."""
    factor = 1.0 + rng.choice((-1.0, 1.0)) * rng.uniform(*off)
    return 0.0 if term == "0" and abs(value) < _NO_CONSTANT else float(f"{factor * value:.3g}")
