"""HFB-320 longitudinal motion, flown in turbulence: elevator 3-2-1-1, then a pulse.

Model and data: R. V. Jategaonkar, Flight Vehicle System Identification, 2nd ed., AIAA 2015 (data: supplement
10.2514/4.102790); the values below are those of its published model. Output-error estimates to compare with:
D. Dutra, AIAA Aviation 2019, arXiv 1909.02838.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from casid.estimation import Problem
from casid.model.system import Model, define_model
from casid.records.record import Record

COLUMNS: tuple[str, ...] = (
    "t",
    "delta_e",
    "qbar",
    "thrust",
    "V",
    "alpha",
    "theta",
    "q",
    "qdot",
    "ax",
    "az",
    "ay",
    "p",
    "r",
    "pdot",
    "rdot",
    "beta",
    "phi",
    "delta_a",
    "delta_r",
)

# published output-error estimates, and standard deviations of about the size that this program finds
PUBLISHED = {
    "CD_0": 0.058022,
    "CD_V": -0.031609,
    "CD_alpha": 0.245348,
    "CL_0": 0.180815,
    "CL_V": 0.201178,
    "CL_alpha": 3.090429,
    "Cm_0": 0.118360,
    "Cm_V": 0.013661,
    "Cm_alpha": -0.994054,
    "Cm_q": -28.6517,
    "Cm_delta_e": -1.471387,
}
PUBLISHED_STD = {
    "CD_0": 0.0006,
    "CD_V": 0.0027,
    "CD_alpha": 0.0055,
    "CL_0": 0.0032,
    "CL_V": 0.018,
    "CL_alpha": 0.031,
    "Cm_0": 0.0008,
    "Cm_V": 0.0045,
    "Cm_alpha": 0.0079,
    "Cm_q": 0.64,
    "Cm_delta_e": 0.016,
}
START = {
    "CD_0": 0.123,
    "CD_V": -0.0645,
    "CD_alpha": 0.32,
    "CL_0": -0.0929,
    "CL_V": 0.149,
    "CL_alpha": 4.33,
    "Cm_0": 0.112,
    "Cm_V": 0.00389,
    "Cm_alpha": -0.968,
    "Cm_q": -34.7,
    "Cm_delta_e": -1.53,
}
BIASES = ("bias_q", "bias_qdot", "bias_ax", "bias_az")
DISTURBANCES = ("w_V", "w_alpha")

_GRAVITY, _RHO, _SPEED = 9.80665, 0.792, 104.67
_AREA_PER_MASS, _MASS, _INCLINATION = 4.028e-3, 7472.0, 0.0524  # m2/kg, kg, rad
_PITCH, _THRUST_PITCH, _HALF_CHORD = 8.0027e-4, -7.0153e-6, 1.215  # S c/Iyy, l/Iyy per N, m


def _forces(s: Any) -> tuple[Any, Any, Any]:
    """Drag and lift acceleration [m/s2] and pitch acceleration [rad/s2]."""
    pressure, speed = 0.5 * _RHO * s.V**2, (s.V - _SPEED) / _SPEED
    drag = pressure * _AREA_PER_MASS * (s.CD_0 + s.CD_V * speed + s.CD_alpha * s.alpha)
    lift = pressure * _AREA_PER_MASS * (s.CL_0 + s.CL_V * speed + s.CL_alpha * s.alpha)
    moment = s.Cm_0 + s.Cm_V * speed + s.Cm_alpha * s.alpha + s.Cm_delta_e * s.delta_e
    moment += s.Cm_q * _HALF_CHORD * s.q / _SPEED
    return drag, lift, _PITCH * pressure * moment + _THRUST_PITCH * s.thrust


def _dynamics(s: Any) -> dict[str, Any]:
    drag, lift, qdot = _forces(s)
    pull, path = s.thrust / _MASS, s.alpha - s.theta
    return {
        "V": -drag + pull * ca.cos(s.alpha + _INCLINATION) + _GRAVITY * ca.sin(path) + s.w_V,
        "alpha": (-lift - pull * ca.sin(s.alpha + _INCLINATION) + _GRAVITY * ca.cos(path)) / s.V + s.q + s.w_alpha,
        "theta": s.q,
        "q": qdot,
    }


def _outputs(s: Any) -> dict[str, Any]:
    drag, lift, qdot = _forces(s)
    pull = s.thrust / _MASS
    ax = -drag * ca.cos(s.alpha) + lift * ca.sin(s.alpha) + pull * np.cos(_INCLINATION)
    az = -drag * ca.sin(s.alpha) - lift * ca.cos(s.alpha) - pull * np.sin(_INCLINATION)
    return {
        "V": s.V,
        "alpha": s.alpha,
        "theta": s.theta,
        "q": s.q + s.bias_q,
        "qdot": qdot + s.bias_qdot,
        "ax": ax + s.bias_ax,
        "az": az + s.bias_az,
    }


def model() -> Model:
    """States V alpha theta q, inputs delta_e and thrust; disturbances are accelerations of V and rates of alpha."""
    return define_model(
        "HFB-320",
        states=("V", "alpha", "theta", "q"),
        inputs=("delta_e", "thrust"),
        parameters=START | dict.fromkeys(BIASES, 0.0),
        outputs=("V", "alpha", "theta", "q", "qdot", "ax", "az"),
        disturbances=DISTURBANCES,
        dynamics=_dynamics,
        output=_outputs,
    )


def record_from(path: str | Path) -> Record:
    """The record `hfb320_1_10.asc` (SI and radians already)."""
    table = np.loadtxt(path)
    channels = dict(zip(COLUMNS[1:], table.T[1:], strict=True))
    return Record(name=Path(path).stem, t=table[:, 0], channels=channels, source=str(path))


def problem(record: Record) -> Problem:
    """The published set-up: eleven derivatives and four biases, free initial state, noise estimated."""
    return Problem(model(), [record], free=["C*", "bias_*"])
