"""Further JSBSim aircraft, for blind tests: jets and propeller aircraft from 1 to 250 tonnes.

Prepared as in `jsbsim_airframe`; their tables stay as nonlinear as JSBSim delivers them, so a model with few terms
leaves something over even when nothing is hidden. DEVELOPMENT aircraft may be looked at while the diagnosis is built,
REPORTING aircraft only when it is judged.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from casid.errors import unknown
from problems.jsbsim.airframe import Airframe

_PISTON = MappingProxyType({"fcs/advance-cmd-norm": 1.0, "fcs/mixture-cmd-norm": 0.9, "propulsion/magneto_cmd": 3.0})


def _frame(
    model: str,
    flown: tuple[float, float],
    engines: int,
    *,
    propeller: bool = False,
    sizes: tuple[float, float, float, float],
    units_s: tuple[float, float, float, float],
    configuration: Mapping[str, float],
    steps: Mapping[str, float],
) -> Airframe:
    """flown: speed [m/s] and altitude [m]; sizes, units_s: elevator, aileron, rudder, throttle."""
    controls = ("delta_e", "delta_a", "delta_r", "throttle")
    return Airframe(
        name=f"{model}, cruise",
        model=model,
        speed_mps=flown[0],
        altitude_m=flown[1],
        engines=engines,
        propeller=propeller,
        sizes=dict(zip(controls, sizes, strict=True)),
        units_s=dict(zip(controls, units_s, strict=True)),
        configuration=configuration,
        configuration_steps=steps,
        controls=_PISTON if propeller else {},
    )


_FRAMES: Mapping[str, Airframe] = MappingProxyType(
    {
        "A320": _frame(
            "A320",
            (200.0, 8000.0),
            2,
            sizes=(0.060, 0.077, 0.017, 0.067),
            units_s=(0.9, 1.2, 1.7, 1.2),
            configuration={"fcs/flap-pos-deg": 8.0},
            steps={"CL": 0.0875, "CD": 0.0232, "Cm": -0.036},
        ),
        "T37": _frame(
            "T37",
            (130.0, 4000.0),
            2,
            sizes=(0.027, 0.046, 0.085, 0.071),
            units_s=(0.6, 0.8, 0.9, 1.0),
            configuration={"fcs/flap-pos-norm": 0.25},
            steps={"CL": 0.0875, "CD": 0.0187},
        ),
        "c310": _frame(
            "c310",
            (72.0, 2000.0),
            2,
            propeller=True,
            sizes=(0.058, 0.150, 0.060, 0.036),
            units_s=(0.5, 0.9, 1.4, 1.0),
            configuration={"fcs/flap-pos-deg": 5.0},
            steps={"CL": 0.0821, "CD": 0.0057, "Cm": -0.0171},
        ),
        "787-8": _frame(
            "787-8",
            (230.0, 10000.0),
            2,
            sizes=(0.060, 0.300, 0.080, 0.077),
            units_s=(1.0, 1.4, 1.9, 1.3),
            configuration={"fcs/speedbrake-pos-norm": 0.5},
            steps={"CL": -0.0986, "CD": 0.0308, "Cm": 0.0032},
        ),
        "f15": _frame(
            "f15",
            (200.0, 6000.0),
            2,
            sizes=(0.020, 0.097, 0.069, 0.048),
            units_s=(0.8, 0.8, 1.1, 1.0),
            configuration={},
            steps={},
        ),
        "c182": _frame(
            "c182",
            (60.0, 1800.0),
            1,
            propeller=True,
            sizes=(0.047, 0.076, 0.048, 0.120),
            units_s=(0.6, 0.8, 1.1, 1.0),
            configuration={"fcs/flap-pos-deg": 3.0},
            steps={"CL": 0.061, "CD": 0.0053, "Cm": -0.0198},
        ),
        "B747": _frame(
            "B747",
            (220.0, 9000.0),
            4,
            sizes=(0.075, 0.300, 0.080, 0.063),
            units_s=(1.3, 1.5, 1.9, 1.4),
            configuration={"fcs/flap-pos-deg": 2.0},
            steps={"CL": 0.1, "CD": 0.0083, "Cm": -0.0153},
        ),
        "OV10": _frame(
            "OV10",
            (100.0, 2500.0),
            2,
            propeller=True,
            sizes=(0.036, 0.056, 0.068, 0.072),
            units_s=(1.0, 1.0, 1.0, 1.0),
            configuration={"fcs/flap-pos-norm": 0.15},
            steps={"CL": 0.099, "CD": 0.0039, "Cm": 0.0026},
        ),
        "global5000": _frame(
            "global5000",
            (220.0, 10000.0),
            2,
            sizes=(0.026, 0.081, 0.045, 0.080),
            units_s=(1.2, 0.9, 1.4, 1.3),
            configuration={"fcs/speedbrake-pos-norm": 1.0},
            steps={"CL": -0.1, "CD": 0.0172},
        ),
        "t6texan2": _frame(
            "t6texan2",
            (120.0, 3000.0),
            1,
            propeller=True,
            sizes=(0.024, 0.025, 0.035, 0.059),
            units_s=(0.5, 0.7, 1.3, 1.0),
            configuration={"fcs/flap-pos-deg": 4.0},
            steps={"CL": 0.0803, "CD": 0.003, "Cm": -0.0051},
        ),
        "A4": _frame(
            "A4",
            (180.0, 6000.0),
            1,
            sizes=(0.018, 0.035, 0.029, 0.046),
            units_s=(0.8, 0.7, 0.8, 1.0),
            configuration={"fcs/flap-pos-deg": 8.0},
            steps={"CL": 0.0934, "CD": 0.0254},
        ),
    }
)
DEVELOPMENT: tuple[str, ...] = ("A320", "T37", "c310", "787-8")
REPORTING: tuple[str, ...] = ("f15", "c182", "B747", "OV10", "global5000", "t6texan2", "A4")


def fleet_airframe(name: str) -> Airframe:
    """The aircraft of that name; InputError when there is none."""
    if name not in _FRAMES:
        raise unknown("JSBSim airframe", name, _FRAMES)
    return _FRAMES[name]
