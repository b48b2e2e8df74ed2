"""How large derivatives are before anything is known of an aircraft."""

from __future__ import annotations

from dataclasses import dataclass

from casid.diagnosis.criterion import number

_FLEET = "measured: 95 % of the aircraft that come with JSBSim are within 1.96 of it, at a lift coefficient of 0.4"


@dataclass(frozen=True, kw_only=True)
class DerivativeSizes:
    """1-sigma about zero of the usual derivatives, by `python -m problems.jsbsim.derivative_sizes`.

    Per rad; rates as p b/2V, q c/2V, r b/2V.
    """

    CL_0: float = number(0.32, "of the lift at zero", _FLEET)
    CL_alpha: float = number(3.6, "of the lift by incidence", _FLEET)
    CL_q: float = number(16, "of the lift by q c/2V", _FLEET)
    CL_delta_e: float = number(0.44, "of the lift by the elevator", _FLEET)
    CD_0: float = number(0.056, "of the drag at zero", _FLEET)
    CD_alpha: float = number(0.38, "of the drag by incidence", _FLEET)
    CD_q: float = number(0.97, "of the drag by q c/2V", _FLEET)
    CD_delta_e: float = number(0.041, "of the drag by the elevator", _FLEET)
    CX_0: float = number(0.065, "of the longitudinal force at zero", _FLEET)
    CX_alpha: float = number(0.44, "of the longitudinal force by incidence", _FLEET)
    CX_q: float = number(0.57, "of the longitudinal force by q c/2V", _FLEET)
    CX_delta_e: float = number(0.028, "of the longitudinal force by the elevator", _FLEET)
    CZ_0: float = number(0.32, "of the normal force at zero", _FLEET)
    CZ_alpha: float = number(3.5, "of the normal force by incidence", _FLEET)
    CZ_q: float = number(16, "of the normal force by q c/2V", _FLEET)
    CZ_delta_e: float = number(0.44, "of the normal force by the elevator", _FLEET)
    CY_beta: float = number(0.76, "of the side force by sideslip", _FLEET)
    CY_p: float = number(0.096, "of the side force by p b/2V", _FLEET)
    CY_r: float = number(0.29, "of the side force by r b/2V", _FLEET)
    CY_delta_a: float = number(0.18, "of the side force by the ailerons", _FLEET)
    CY_delta_r: float = number(0.23, "of the side force by the rudder", _FLEET)
    Cl_beta: float = number(0.075, "of the rolling moment by sideslip", _FLEET)
    Cl_p: float = number(0.26, "of the rolling moment by p b/2V", _FLEET)
    Cl_r: float = number(0.11, "of the rolling moment by r b/2V", _FLEET)
    Cl_delta_a: float = number(0.13, "of the rolling moment by the ailerons", _FLEET)
    Cl_delta_r: float = number(0.021, "of the rolling moment by the rudder", _FLEET)
    Cm_0: float = number(0.062, "of the pitching moment at zero", _FLEET)
    Cm_alpha: float = number(1.2, "of the pitching moment by incidence", _FLEET)
    Cm_q: float = number(24, "of the pitching moment by q c/2V", _FLEET)
    Cm_delta_e: float = number(0.79, "of the pitching moment by the elevator", _FLEET)
    Cn_beta: float = number(0.25, "of the yawing moment by sideslip", _FLEET)
    Cn_p: float = number(0.091, "of the yawing moment by p b/2V", _FLEET)
    Cn_r: float = number(0.69, "of the yawing moment by r b/2V", _FLEET)
    Cn_delta_a: float = number(0.021, "of the yawing moment by the ailerons", _FLEET)
    Cn_delta_r: float = number(0.15, "of the yawing moment by the rudder", _FLEET)

    def of(self, derivative: str) -> float | None:
        """By its name, as "CL_alpha"; None of one that is not usual."""
        return getattr(self, derivative, None)
