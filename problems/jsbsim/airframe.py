"""The JSBSim aircraft that are flown, and how their files are prepared.

The aircraft's aerodynamics, mass, engines and propellers are JSBSim's own. Prepared means:
- the stock control system (autopilot, dampers, stick shaping) is replaced by three servos, so that the recorded
  command of a surface is its position in radians when nothing is wrong;
- alpha-dot derivatives are off (a healthy aircraft here is quasi-steady); `unsteady_aero` switches them on;
- propellers turn without torque reaction, P-factor and gyroscopic moment; the fault `propeller_moments` restores them;
  their slipstream does not act on the wing and tail (JSBSim's table jumps at the trimmed angle of attack);
- drag is smooth where JSBSim's has a kink at zero, and the aerodynamic reference point lies at the c.g.'s height;
- tables over the Reynolds number are read at that of trim;
- fuel does not burn, the earth does not turn, and gravity is spherical.

Signs: delta_e trailing edge down (Cm_delta_e < 0), delta_a rolls to the right (Cl_delta_a > 0), delta_r trailing edge
left (Cn_delta_r < 0).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

from casid.errors import unknown

RATE_HZ = 200.0  # of the simulation
FT = 0.3048
SLUG = 14.593902937206364
LBF = 4.4482216152605
SLUG_FT2 = SLUG * FT**2


@dataclass(frozen=True, kw_only=True)
class Airframe:
    """A JSBSim aircraft, its trim point and the size of inputs that suits it.

    sizes          input per control that gives some 3 deg of alpha, 3-4 deg of beta, 10-20 deg/s of p
    units_s        time unit of the multi-step inputs per control
    configuration  properties that an unrecorded change of configuration sets; `configuration_steps`: what
                   JSBSim's file then adds to the coefficients at trim
    controls       properties held throughout (propeller, mixture, magnetos)
    curvature      (coefficient, term, size) that JSBSim's tables have beside the linear derivatives, small in flight
    torque_limit_lbft  by engine: replaces a limit that keeps the bundled engine from delivering its power
    """

    name: str
    model: str
    speed_mps: float
    altitude_m: float
    engines: int
    propeller: bool
    sizes: Mapping[str, float]
    units_s: Mapping[str, float]
    configuration: Mapping[str, float]
    configuration_steps: Mapping[str, float]
    controls: Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}))
    torque_limit_lbft: Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}))
    curvature: tuple[tuple[str, str, float], ...] = ()


AIRFRAMES: Mapping[str, Airframe] = MappingProxyType(
    {
        "fokker50": Airframe(
            name="Fokker 50, cruise",
            model="fokker50",
            speed_mps=95.0,
            altitude_m=2500.0,
            engines=2,
            propeller=True,
            sizes={"delta_e": 0.075, "delta_a": 0.20, "delta_r": 0.045, "throttle": 0.05},
            units_s={"delta_e": 0.7, "delta_a": 1.2, "delta_r": 1.2, "throttle": 1.0},
            configuration={"fcs/flap-pos-norm": 0.1, "gear/gear-pos-norm": 1.0},
            configuration_steps={"CL": 0.06, "CD": 0.046},
            controls={"fcs/advance-cmd-norm": 0.825},
            torque_limit_lbft={"PW125BX": 20000.0},
            curvature=(("Cl", "alpha*r", 1.45), ("Cl", "alpha*beta", -0.03)),
        ),
        "737": Airframe(
            name="737, cruise",
            model="737",
            speed_mps=160.0,
            altitude_m=6000.0,
            engines=2,
            propeller=False,
            sizes={"delta_e": 0.055, "delta_a": 0.11, "delta_r": 0.045, "throttle": 0.10},
            units_s={"delta_e": 0.9, "delta_a": 1.4, "delta_r": 1.4, "throttle": 1.2},
            configuration={"fcs/flap-pos-norm": 0.1},
            configuration_steps={"CL": 0.09, "CD": 0.006},
        ),
        "pa28": Airframe(
            name="PA-28, cruise",
            model="pa28",
            speed_mps=45.0,
            altitude_m=1500.0,
            engines=1,
            propeller=True,
            sizes={"delta_e": 0.09, "delta_a": 0.12, "delta_r": 0.07, "throttle": 0.10},
            units_s={"delta_e": 0.45, "delta_a": 0.8, "delta_r": 0.8, "throttle": 1.0},
            configuration={"fcs/flap-pos-deg": 10.0},
            configuration_steps={"CL": 0.043, "CD": 0.0067, "Cm": -0.044},
            controls={"fcs/advance-cmd-norm": 1.0, "fcs/mixture-cmd-norm": 0.9, "propulsion/magneto_cmd": 3},
            curvature=(("CL", "alpha^2", 2.0),),
        ),
    }
)


def airframe(name: str) -> Airframe:
    """The airframe of that name; InputError when there is none."""
    if name not in AIRFRAMES:
        raise unknown("JSBSim airframe", name, AIRFRAMES)
    return AIRFRAMES[name]
