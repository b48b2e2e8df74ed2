"""Do 328-100 in cruise, the aircraft of Oezger, AIAA 2010-34: Table 2 (stable) and Table 3 (destabilised)."""

from __future__ import annotations

from casid.model.aircraft import Aircraft, Inertia

V_TRIM = 144.0
THRUST = 10e3
STABLE = {
    "CL_0": 0.221,
    "CL_alpha": 6.0,
    "CL_delta_e": 0.349,
    "CL_q": 4.39,
    "CD_0": 0.027,
    "CD_alpha": -0.002,
    "CY_0": 0.0,
    "CY_beta": -1.195,
    "CY_delta_a": 0.0,
    "CY_delta_r": 0.389,
    "CY_p": 0.109,
    "CY_r": 0.576,
    "Cl_0": 0.0,
    "Cl_p": -1.118,
    "Cl_r": 0.295,
    "Cl_beta": -0.285,
    "Cl_delta_a": -0.299,
    "Cl_delta_r": 0.099,
    "Cm_0": 0.127,
    "Cm_alpha": -1.678,
    "Cm_delta_e": -1.93,
    "Cm_q": -26.0,
    "Cn_0": 0.0,
    "Cn_p": -0.140,
    "Cn_r": -0.619,
    "Cn_beta": 0.366,
    "Cn_delta_a": -0.0065,
    "Cn_delta_r": -0.392,
}
# Cm_alpha of Table 3 is misprinted in the source; 0.08 follows from the ratio of two errors in its Table 5
DESTABILISED = STABLE | {"Cm_alpha": 0.08, "Cm_q": -5.0, "Cl_beta": 0.12, "Cl_p": 0.5, "Cn_beta": -0.5, "Cn_r": 0.12}
MOMENT_DERIVATIVES = tuple(name for name in STABLE if name[:2] in ("Cl", "Cm", "Cn"))


def do328(derivatives: dict[str, float] | None = None) -> Aircraft:
    """The aircraft; rates are made dimensionless with the half span 10.4 m and the mean chord 2.04 m."""
    return Aircraft(
        name="Do 328-100, cruise",
        mass=10500.0,
        inertia=Inertia(Ixx=103e3, Iyy=158e3, Izz=240e3, Ixz=12.5e3),
        gravity=9.81,
        area=40.0,
        moment_length_lateral=10.4,
        moment_length_pitch=2.04,
        rate_length_lateral=10.4,
        rate_length_pitch=2.04,
        engine_y=(-2.5, 2.5),
        trim={"V": V_TRIM, "thrust": THRUST},
        derivatives=STABLE if derivatives is None else derivatives,
    )
