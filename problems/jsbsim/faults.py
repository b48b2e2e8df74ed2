"""Hidden effects, by the names of `casid.model.vocabulary`, made in JSBSim or in the chain of instruments.

In the aircraft (`edit_of`): servos, further aerodynamic terms, mass properties, engine positions.
In flight (`schedule_of`): loss of effectiveness, change of configuration, gusts, wind shear, turbulence.
In the instruments (`instrument_fault`): bias, scale, delay, lag, position, structural mode.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy import signal

from casid.errors import InputError
from casid.model.causes.instruments import SENSOR_GROUPS
from casid.model.vocabulary import check_effect, effect_unit
from problems.jsbsim.airframe import FT, Airframe
from problems.jsbsim.edit import Edit

_RAMP_S, _GUST_S = 1.0, 2.0
_EVENTS = ("effectiveness_change", "configuration_change", "gust", "wind_shear")
_DRIVES = {"q": "delta_e", "az": "delta_e", "p": "delta_a", "r": "delta_r", "ay": "delta_r"}
_TWINS = {"p": "pdot", "q": "qdot", "r": "rdot"}
# effects that the vocabulary does not have, for a diagnosis to refuse
OUTSIDE = ("propeller_moments",)
_MAX_SEVERITY = 7
_LATERAL = ("CY", "Cl", "Cn")


@dataclass(frozen=True, kw_only=True)
class Fault:
    """One hidden effect; `kind`, `target`, `term`, the unit and sign of `size` are those of the vocabulary.

    kind may also be one of OUTSIDE, which has no name in the vocabulary.
    onset_s       start of an event: effectiveness_change, configuration_change, gust, wind_shear
    duration_s    length of a gust, 2 s by default, or of the ramp of a shear, which by default does not end
    frequency_hz, damping  of a structural mode
    A configuration change has size 1.0: the airframe's own. For turbulence, size is JSBSim's severity (MIL-F-8785C,
    1 light to 7), from which the r.m.s. velocity follows with the altitude.
    Raises InputError for what does not fit together.
    """

    kind: str
    target: str = ""
    term: str | None = None
    size: float
    onset_s: float | None = None
    duration_s: float | None = None
    frequency_hz: float = 4.0
    damping: float = 0.03

    def __post_init__(self) -> None:
        if self.kind in OUTSIDE:
            return
        check_effect(self.kind, self.target, self.term, "fault")
        if (self.kind in _EVENTS) != (self.onset_s is not None):
            verb = "needs" if self.kind in _EVENTS else "has no"
            raise InputError(f"fault '{self.kind}' {verb} onset_s, got {self.onset_s}; events are {', '.join(_EVENTS)}")
        if self.kind == "turbulence" and not 1 <= self.size <= _MAX_SEVERITY:
            raise InputError(f"fault 'turbulence': size is JSBSim's severity, expected 1 to 7, got {self.size}")

    @property
    def unit(self) -> str:
        """SI unit of `size`."""
        return "1" if self.kind in OUTSIDE else effect_unit(self.kind, self.target, self.term)


def edit_of(fault: Fault | None) -> Edit:
    """The change of the JSBSim aircraft file that makes the fault; the null edit when it is made elsewhere."""
    if fault is None:
        return Edit()
    kind, target, size = fault.kind, fault.target, fault.size
    if kind in ("actuator_lag", "input_delay", "rate_limit", "dead_zone", "backlash"):
        return Edit(servo={target: (kind, size)})
    if kind == "aero_term":
        return Edit(term=(target, fault.term or "", size))
    if kind == "unsteady_aero":
        return Edit(term=(target, "betadot" if target in _LATERAL else "alphadot", size))
    if kind == "mass":
        return Edit(ballast_kg=size)
    if kind == "cg_offset":
        return Edit(cg_shift_m={target: size})
    if kind == "inertia":
        return Edit(inertia_kgm2={target: size})
    if kind in ("thrust_asymmetry", "thrust_line"):
        return Edit(engine_shift_m={"y" if kind == "thrust_asymmetry" else "z": size})
    return Edit(propeller_moments=kind == "propeller_moments")


def schedule_of(fault: Fault | None, frame: Airframe, t: np.ndarray, seed: int) -> dict[str, np.ndarray]:
    """JSBSim properties over the record, (N,) each, that make the fault; NaN leaves a property alone."""
    if fault is None:
        return {}
    if fault.kind == "turbulence":
        once = np.where(np.arange(len(t)) == 0, 1.0, np.nan)
        return {
            "simulation/randomseed": once * seed,
            "atmosphere/turbulence/milspec/windspeed_at_20ft_AGL-fps": once * 30.0,
            "atmosphere/turbulence/milspec/severity": once * fault.size,
            "atmosphere/turb-type": once * 4.0,
        }
    if fault.onset_s is None:
        return {}
    after = np.where(t >= fault.onset_s, 1.0, 0.0)
    ramp = np.clip((t - fault.onset_s) / _RAMP_S, 0.0, 1.0)
    if fault.kind == "effectiveness_change":
        name = "throttle" if fault.target == "thrust" else f"flight/{fault.target}-effectiveness"
        engines = range(frame.engines) if fault.target == "thrust" else ("",)
        return {f"{name}[{e}]" if fault.target == "thrust" else name: 1.0 + fault.size * after for e in engines}
    if fault.kind == "configuration_change":
        return {name: value * fault.size * ramp for name, value in frame.configuration.items()}
    if fault.kind == "wind_shear":
        return {f"wind[{fault.target}]": fault.size * np.clip(t - fault.onset_s, 0.0, fault.duration_s)}
    return _gust(fault, t)


def _gust(fault: Fault, t: np.ndarray) -> dict[str, np.ndarray]:
    """JSBSim's own 1-cosine gust along a body axis."""
    first = np.where(np.arange(len(t)) == 0, 1.0, np.nan)
    start = np.full(len(t), np.nan)
    start[np.searchsorted(t, fault.onset_s or 0.0)] = 1.0
    gust = "atmosphere/cosine-gust"
    sign, axis = np.sign(fault.size), fault.target.upper()
    return {
        f"{gust}/startup-duration-sec": first * (fault.duration_s or _GUST_S) / 2,
        f"{gust}/steady-duration-sec": first * 0.0,
        f"{gust}/end-duration-sec": first * (fault.duration_s or _GUST_S) / 2,
        f"{gust}/magnitude-ft_sec": first * abs(fault.size) / FT,
        f"{gust}/frame": first,
        **{f"{gust}/{a}-velocity-ft_sec": first * (sign if a == axis else 0.0) for a in "XYZ"},
        f"{gust}/start": start,
    }


def sensor_position(fault: Fault | None, instrument: str) -> np.ndarray:
    """(3,) true position [m] of an instrument ("accelerometer", "alpha", "beta") from the actual centre of gravity,
    body axes; the aircraft file has it at its centre of gravity."""
    position = np.zeros(3)
    if fault is not None:
        axis = fault.target if fault.target in ("x", "y", "z") else "x"
        if fault.kind == "cg_offset":
            position["xyz".index(axis)] = -fault.size
        elif (fault.kind, instrument) == ("accelerometer_position", "accelerometer") or (
            fault.kind == "vane_position" and fault.target == instrument
        ):
            position["xyz".index(axis)] = fault.size
    return position


def instrument_fault(fault: Fault | None, t: np.ndarray, channels: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """What faulty instruments read, (N,) per channel, before sampling and noise."""
    out = dict(channels)
    if fault is None:
        return out
    if fault.kind == "structural_mode":
        w0 = 2.0 * np.pi * fault.frequency_hz
        drive = channels[_DRIVES[fault.target]]
        law = [1.0, 2.0 * fault.damping * w0, w0**2]
        shaken = ((fault.target, [w0**2, 0.0]), (_TWINS.get(fault.target, ""), [w0**2, 0.0, 0.0]))
        for name, numerator in shaken:
            if name in channels:
                out[name] = channels[name] + fault.size * signal.lsim((numerator, law), drive - drive[0], t)[1]
        return out
    group = SENSOR_GROUPS.get(fault.target, (fault.target, _TWINS.get(fault.target, fault.target)))
    for name in dict.fromkeys(group):
        if name not in out:
            continue
        x = channels[name]
        if fault.kind == "sensor_bias" and name == fault.target:
            out[name] = x + fault.size
        elif fault.kind == "sensor_scale":
            out[name] = (1.0 + fault.size) * x
        elif fault.kind == "sensor_delay":
            out[name] = np.interp(t - fault.size, t, x)
        elif fault.kind == "sensor_lag":
            _, lagged, _ = signal.lsim(([1.0], [fault.size, 1.0]), x - x[0], t)
            out[name] = x[0] + lagged
    return out
