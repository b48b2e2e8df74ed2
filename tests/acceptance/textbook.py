"""Aircraft of textbooks, in the units of casid, with the system matrices that the books print."""

from __future__ import annotations

import numpy as np

import casid as cs
from casid.signals import FOOT, SLUG

POUND = 4.4482216152605  # N


def inertia(Ixx: float, Iyy: float, Izz: float) -> cs.Inertia:
    """Of moments in slug ft2."""
    unit = SLUG * FOOT**2
    return cs.Inertia(Ixx=Ixx * unit, Iyy=Iyy * unit, Izz=Izz * unit, Ixz=0.0)


def navion() -> cs.Aircraft:
    """North American Navion, sea level, 176 ft/s: Nelson, Flight Stability and Automatic Control, 2nd ed., table B.1.
    Lift by pitch rate is left out, as the book does in its system matrix."""
    return cs.Aircraft(
        name="Navion",
        mass=2750.0 * POUND / 9.80665,
        inertia=inertia(1048.0, 3000.0, 3530.0),
        area=184.0 * FOOT**2,
        moment_length_lateral=33.4 * FOOT,
        moment_length_pitch=5.7 * FOOT,
        rate_length_lateral=16.7 * FOOT,
        rate_length_pitch=2.85 * FOOT,
        trim={"V": 176.0 * FOOT, "rho": 0.002378 * SLUG / FOOT**3},
        derivatives={
            "CL_0": 0.41,
            "CL_alpha": 4.44,
            "CL_delta_e": 0.355,
            "CD_0": 0.05,
            "CD_alpha": 0.33,
            "Cm_0": 0.0,
            "Cm_alpha": -0.683,
            "Cm_q": -9.96,
            "Cm_delta_e": -0.923,
            "CY_beta": -0.564,
            "CY_delta_r": 0.157,
            "Cl_beta": -0.074,
            "Cl_p": -0.410,
            "Cl_r": 0.107,
            "Cl_delta_a": -0.134,
            "Cl_delta_r": 0.107,
            "Cn_beta": 0.071,
            "Cn_p": -0.0575,
            "Cn_r": -0.125,
            "Cn_delta_a": 0.0035,
            "Cn_delta_r": -0.072,
        },
        terms={"Cm": {"alphadot": -4.36}},
    )


# Nelson, example problem of chapter 4: u, w, q, theta in ft, s, rad
NAVION_LONGITUDINAL = np.array(
    [
        [-0.045, 0.036, 0.0, -32.2],
        [-0.369, -2.02, 176.0, 0.0],
        [0.0019, -0.0396, -2.948, 0.0],
        [0.0, 0.0, 1.0, 0.0],
    ]
)


def boeing_747() -> cs.Aircraft:
    """Boeing 747-100, 40000 ft, Mach 0.8: Etkin and Reid, Dynamics of Flight, 3rd ed., tables 6.1 and E.1.

    In stability axes, with CZ_0 = -0.654 and no drag or thrust: those of the book are in its derivatives by speed.
    """
    return cs.Aircraft(
        name="Boeing 747-100",
        mass=636636.0 * POUND / 9.80665,
        inertia=inertia(0.183e8, 0.331e8, 0.497e8),
        area=5500.0 * FOOT**2,
        moment_length_lateral=195.7 * FOOT,
        moment_length_pitch=27.31 * FOOT,
        rate_length_lateral=97.85 * FOOT,
        rate_length_pitch=13.655 * FOOT,
        force_axes="body",
        trim={"V": 774.0 * FOOT, "rho": 0.0005909 * SLUG / FOOT**3},
        derivatives={
            "CX_0": 0.0,
            "CX_alpha": 0.2193,
            "CZ_0": -0.654,
            "CZ_alpha": -4.920,
            "CZ_q": -5.921,
            "CZ_delta_e": -0.338,
            "Cm_0": 0.0,
            "Cm_alpha": -1.023,
            "Cm_q": -23.92,
            "Cm_delta_e": -1.2,
        },
        terms={"CX": {"V": -0.1080}, "CZ": {"V": -0.1060, "alphadot": 5.896}, "Cm": {"V": 0.1043, "alphadot": -6.314}},
    )


# Etkin and Reid, equation (6.2,1): u, w, q, theta in ft, s, rad
BOEING_747_LONGITUDINAL = np.array(
    [
        [-0.006868, 0.01395, 0.0, -32.2],
        [-0.09055, -0.3151, 773.98, 0.0],
        [0.0001187, -0.001026, -0.4285, 0.0],
        [0.0, 0.0, 1.0, 0.0],
    ]
)
