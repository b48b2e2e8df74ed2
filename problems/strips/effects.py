"""What is hidden in a set. Kind, target, sign and unit are those of the answer; what acts is written here."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from problems.strips.planes import SURFACES, Plane

RECORDS = ("m1", "m2", "m3", "m4")  # the last is held back
_DEG = np.pi / 180.0


@dataclass(frozen=True, kw_only=True)
class Effect:
    """One hidden effect; records that have it, and record -> start [s] of an event."""

    kind: str
    value: float
    target: str = ""
    term: str | None = None
    records: tuple[str, ...] = RECORDS
    onset_s: Mapping[str, float] | None = None
    parameters: Mapping[str, float] = field(default_factory=dict)

    @property
    def has(self) -> np.ndarray:
        """(records,) 1 for those that have it."""
        return np.array([float(name in self.records) for name in RECORDS])

    @property
    def onset(self) -> np.ndarray:
        """(records,) start [s]; never in those without."""
        return np.array([(self.onset_s or {}).get(name, np.inf) for name in RECORDS])


# case -> (kind, target, term), one effect each
ONE: Mapping[str, tuple[str, str, str | None]] = {
    "one-1": ("actuator_lag", "delta_e", None),
    "one-2": ("input_delay", "delta_a", None),
    "one-3": ("rate_limit", "delta_r", None),
    "one-4": ("backlash", "delta_e", None),
    "one-5": ("dead_zone", "delta_a", None),
    "one-6": ("effectiveness_change", "delta_r", None),
    "one-7": ("effectiveness_change", "thrust", None),
    "one-8": ("feedback", "delta_r", "r"),
    "one-9": ("stuck", "delta_e", None),
    "one-10": ("sensor_bias", "q", None),
    "one-11": ("sensor_bias", "ay", None),
    "one-12": ("sensor_scale", "beta", None),
    "one-13": ("sensor_scale", "V", None),
    "one-14": ("sensor_delay", "alpha", None),
    "one-15": ("sensor_delay", "air_data", None),
    "one-16": ("vane_position", "beta", None),
    "one-17": ("accelerometer_position", "x", None),
    "one-18": ("cg_offset", "x", None),
    "one-19": ("mass", "", None),
    "one-20": ("thrust_scale", "", None),
    "one-21": ("thrust_line", "", None),
    "one-22": ("gust", "z", None),
    "one-23": ("wind_shear", "x", None),
    "one-24": ("configuration_change", "CL+CD+Cm", None),
}
TWO: Mapping[str, tuple[str, str]] = {
    "two-1": ("one-1", "one-14"),
    "two-2": ("one-19", "one-16"),
    "two-3": ("one-22", "one-5"),
    "two-4": ("one-18", "one-12"),
    "two-5": ("one-6", "one-17"),
    "two-6": ("one-2", "one-10"),
}
OUTSIDE = ("rotor_gyroscope", "propeller_hum", "sensor_drift", "stall_break", "wing_bending", "slow_change")
CASES = (*(f"clean-{i}" for i in range(1, 7)), *ONE, *TWO, *OUTSIDE)
_EVENTS = ("effectiveness_change", "gust", "wind_shear", "configuration_change", "stuck")
_SOME = {"cg_offset": 2, "mass": 1, "gust": 2, "effectiveness_change": 2, "wind_shear": 1, "stuck": 1}


def draw(case: str, plane: Plane, rng: np.random.Generator) -> tuple[Effect, ...]:
    """The effects of a case; none of a clean one."""
    if case.startswith("clean"):
        return ()
    if case in OUTSIDE:
        value = {"sensor_drift": 0.6 * _DEG, "slow_change": -0.45, "rotor_gyroscope": 0.35 * plane.inertia[1]}
        size = value.get(case, 1.0) * float(rng.uniform(0.8, 1.25))
        target = {"sensor_drift": "q", "slow_change": "delta_e"}.get(case, "")
        parameters = {"frequency_hz": round(float(rng.uniform(1.2, 2.2)), 2), "period_s": 60.0}
        return (Effect(kind=case, target=target, value=float(f"{size:.4g}"), parameters=parameters),)
    return tuple(_draw(*ONE[one], plane, rng) for one in TWO.get(case, (case,)))


def _draw(kind: str, target: str, term: str | None, plane: Plane, rng: np.random.Generator) -> Effect:
    u, sign = rng.uniform, rng.choice((-1.0, 1.0))
    chord, move = plane.wing[1], plane.size.get(target, 0.0)
    size = {
        "actuator_lag": u(0.12, 0.22),
        "input_delay": u(0.1, 0.18),
        "rate_limit": 2.0 * move / u(0.5, 0.8),
        "backlash": move * u(0.18, 0.3),
        "dead_zone": move * u(0.2, 0.35),
        "effectiveness_change": -u(0.25, 0.4),
        "feedback": u(0.3, 0.6),
        "stuck": 1.0,
        "sensor_bias": sign * (u(0.5, 0.9) * _DEG if target in "pqr" else u(0.3, 0.5)),
        "sensor_scale": sign * u(0.07, 0.12),
        "sensor_delay": u(0.1, 0.18),
        "vane_position": u(1.5, 3.0),
        "accelerometer_position": sign * chord * u(0.5, 0.9),
        "cg_offset": sign * chord * u(0.06, 0.1),
        "mass": sign * plane.mass * u(0.09, 0.14),
        "thrust_scale": sign * u(0.12, 0.2),
        "thrust_line": sign * chord * u(0.25, 0.4),
        "gust": sign * plane.V * u(0.05, 0.08),
        "wind_shear": sign * u(0.5, 0.9),
        "configuration_change": u(0.06, 0.1),  # rad of incidence of the inner wing
    }[kind]
    some = _SOME.get(kind, len(RECORDS))
    records = RECORDS if some == len(RECORDS) else tuple(sorted(rng.choice(RECORDS[:-1], some, replace=False).tolist()))
    return Effect(
        kind=kind,
        target=target,
        term=term,
        value=float(f"{size:.4g}"),
        records=records,
        onset_s={name: round(float(u(7.0, 15.0)), 2) for name in records} if kind in _EVENTS else None,
        parameters={"length": round(float(u(1.5, 3.0)), 2), "ramp": round(float(u(2.0, 5.0)), 2)},
    )


class Linkage:
    """Between the servo, which is recorded, and the surfaces: nothing, or what is hidden. It has a memory."""

    def __init__(self, effects: Sequence[Effect], at_rest: np.ndarray, dt: float) -> None:
        self._effects = [e for e in effects if e.target in SURFACES]
        self._dt, self._acting, self._past = dt, at_rest.copy(), [at_rest.copy()]

    def moved(self, t: float, servo: np.ndarray, rates: Mapping[str, np.ndarray]) -> np.ndarray:
        """(3, n) surfaces at t [s], a step after the last call, with the servos there and the rates of the body."""
        self._past.append(servo.copy())
        now = servo.copy()
        for one in self._effects:
            i = SURFACES.index(one.target)
            now[i] = np.where(one.has > 0.0, self._behind(one, i, t, rates), servo[i])
        self._acting = now
        return now

    def _behind(self, one: Effect, i: int, t: float, rates: Mapping[str, np.ndarray]) -> np.ndarray:
        servo, before, dt = self._past[-1][i], self._acting[i], self._dt
        since = t >= one.onset
        if one.kind == "actuator_lag":
            return servo + np.exp(-dt / one.value) * (before - servo)
        if one.kind == "input_delay":
            back = one.value / dt
            whole, part = int(back), back - int(back)
            older = [self._past[max(len(self._past) - 1 - k, 0)][i] for k in (whole, whole + 1)]
            return (1.0 - part) * older[0] + part * older[1]
        if one.kind == "rate_limit":
            return before + np.clip(servo - before, -one.value * dt, one.value * dt)
        if one.kind == "backlash":
            return np.clip(before, servo - one.value, servo + one.value)
        rest = self._past[0][i]
        if one.kind == "dead_zone":
            return servo - np.clip(servo, -one.value, one.value)
        if one.kind == "feedback":
            return servo + one.value * rates[one.term or "r"]
        if one.kind == "stuck":
            ends = t < one.onset + 6.0
            return np.where(since & ends, before, servo)
        if one.kind == "slow_change":
            return rest + (servo - rest) * (1.0 + one.value * 0.5 * (1.0 - np.cos(2.0 * np.pi * t / 30.0)))
        return rest + (servo - rest) * (1.0 + one.value * since)  # a loss of effectiveness
