"""ATTAS (VFW-614): real flight, lateral and longitudinal manoeuvres, in models with dimensional derivatives.

Data: supplement 10.2514/4.102790 of R. V. Jategaonkar, Flight Vehicle System Identification, 2nd ed., AIAA 2015. The
independent values are output-error estimates of another program on the same records, inputs linear between samples.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from casid.errors import InputError
from casid.estimation import Problem
from casid.model.aircraft import Aircraft, Inertia
from casid.model.system import Model, define_model
from casid.records.column_map import ColumnMap
from casid.records.readers import read_record
from casid.records.record import Record

COLUMNS = ColumnMap.from_options(
    [
        "t=1",
        "ax=2",
        "ay=3",
        "az=4",
        "p=7:deg/s",
        "q=8:deg/s",
        "r=9:deg/s",
        "phi=10:deg",
        "theta=11:deg",
        "psi=12:deg",
        "alpha=13:deg",
        "beta=14:deg",
        "V=15",
        "altitude=16:ft",
        "pdot=17:deg/s2",
        "qdot=18:deg/s2",
        "rdot=19:deg/s2",
        "delta_e=22:deg",
        "delta_a=0.5*29:deg,-0.5*28:deg",
        "delta_r=30:deg",
        "rho=34",
        "thrust=1*37,1*38",
    ]
)
_GAP = 1.0  # s

LATERAL = {
    "Lp": -2.0486,
    "Lr": 1.0786,
    "Lda": -6.2859,
    "Ldr": 1.1704,
    "Lb": -3.7544,
    "Np": -0.17432,
    "Nr": -0.46721,
    "Nda": -0.36744,
    "Ndr": -1.69576,
    "Nb": 2.99233,
}
LONGITUDINAL = {"Za": -0.48336, "Ma": -4.92651, "Mq": -2.00573, "Mde": -7.20807}

# handbook values of a twin-jet transport, good enough to start from; what is not here starts from zero
_FIRST_GUESS = {
    "CL_0": 0.2,
    "CL_alpha": 5.0,
    "CD_0": 0.03,
    "Cm_alpha": -1.0,
    "Cm_q": -15.0,
    "Cm_delta_e": -1.5,
    "CY_beta": -0.9,
    "Cl_beta": -0.1,
    "Cl_p": -0.6,
    "Cl_delta_a": -0.2,
    "Cn_beta": 0.15,
    "Cn_r": -0.2,
    "Cn_delta_r": -0.15,
}
_LONGITUDINAL_TERMS, _LATERAL_TERMS = ("0", "alpha", "q", "delta_e"), ("0", "beta", "p", "r", "delta_a", "delta_r")
_TERMS = {
    "CL": _LONGITUDINAL_TERMS,
    "CD": ("0", "alpha", "delta_e"),
    "CY": _LATERAL_TERMS,
    "Cl": _LATERAL_TERMS,
    "Cm": _LONGITUDINAL_TERMS,
    "Cn": _LATERAL_TERMS,
}


def aircraft() -> Aircraft:
    """A linear aircraft file for the diagnosis: mass properties of the supplement, derivatives to be found.

    One elevator, aileron and rudder angle; thrust, the sum of both engines, along the body axis through the c.g.
    """
    derivatives = {f"{c}_{term}": _FIRST_GUESS.get(f"{c}_{term}", 0.0) for c, terms in _TERMS.items() for term in terms}
    return Aircraft(
        name="ATTAS",
        mass=17631.0,
        inertia=Inertia(Ixx=1.33367e5, Iyy=2.52687e5, Izz=3.59593e5, Ixz=1.1442e4),
        area=64.0,
        moment_length_lateral=21.5,
        moment_length_pitch=3.159,
        rate_length_lateral=10.75,
        rate_length_pitch=1.5795,
        derivatives=derivatives,
    )


def records_from(folder: str | Path, name: str) -> list[Record]:
    """The record of `NAME.mat`; one that holds several manoeuvres is cut where its time jumps, into NAME-1, NAME-2."""
    path = Path(folder) / f"{name}.mat"
    if not path.is_file():
        raise InputError(f"{path}: no such file; expected the ATTAS records there, see README under 'Flight data'")
    whole = read_record(path, COLUMNS)
    cuts = [-np.inf, *(whole.t[1:][np.diff(whole.t) > _GAP]), np.inf]
    parts = [whole.between(start, stop) for start, stop in zip(cuts[:-1], cuts[1:], strict=True)]
    if len(parts) == 1:
        return [whole]
    return [replace(part, name=f"{name}-{i}") for i, part in enumerate(parts, start=1)]


def lateral_model() -> Model:
    """Roll and yaw: states p, r; inputs delta_a, delta_r and the measured sideslip; offsets L0, N0.

    Disturbances, here and in the other model, are additions to the two rates.
    """

    def rates(s: Any) -> dict[str, Any]:
        return {
            "p": s.Lp * s.p + s.Lr * s.r + s.Lda * s.delta_a + s.Ldr * s.delta_r + s.Lb * s.beta + s.L0 + s.w_p,
            "r": s.Np * s.p + s.Nr * s.r + s.Nda * s.delta_a + s.Ndr * s.delta_r + s.Nb * s.beta + s.N0 + s.w_r,
        }

    def output(s: Any) -> dict[str, Any]:
        return {"pdot": rates(s)["p"], "rdot": rates(s)["r"], "p": s.p, "r": s.r}

    return define_model(
        "ATTAS lateral",
        states=("p", "r"),
        inputs=("delta_a", "delta_r", "beta"),
        parameters=dict.fromkeys((*LATERAL, "L0", "N0"), 0.0),
        outputs=("pdot", "rdot", "p", "r"),
        disturbances=("w_p", "w_r"),
        dynamics=rates,
        output=output,
    )


def longitudinal_model() -> Model:
    """Short period: states alpha, q; input delta_e; Zq is the part of q beyond the turning of the body axes."""

    def rates(s: Any) -> dict[str, Any]:
        return {
            "alpha": s.Z0 + s.Za * s.alpha + (1.0 + s.Zq) * s.q + s.Zde * s.delta_e + s.w_alpha,
            "q": s.M0 + s.Ma * s.alpha + s.Mq * s.q + s.Mde * s.delta_e + s.w_q,
        }

    return define_model(
        "ATTAS longitudinal",
        states=("alpha", "q"),
        inputs=("delta_e",),
        parameters=dict.fromkeys((*LONGITUDINAL, "Zq", "Zde", "Z0", "M0"), 0.0),
        outputs=("alpha", "q"),
        disturbances=("w_alpha", "w_q"),
        dynamics=rates,
        output=lambda s: {"alpha": s.alpha, "q": s.q},
    )


def lateral_problem(records: list[Record]) -> Problem:
    """All derivatives and offsets free, one value for all manoeuvres; noise estimated."""
    return Problem(lateral_model(), records, free=["*"])


def longitudinal_problem(records: list[Record]) -> Problem:
    """All derivatives and offsets free, one value for all manoeuvres; noise estimated."""
    return Problem(longitudinal_model(), records, free=["*"])
