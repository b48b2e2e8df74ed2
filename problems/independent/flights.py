"""Fly a set: five records of one aircraft, four to fit and one to hold back, with what a case hides in them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from problems.independent import air
from problems.independent.actuators import follow, lag, limited, played, spool
from problems.independent.aircraft_file import Fit, fitted, guessed
from problems.independent.atmosphere import air_at
from problems.independent.effects import CASES, INSTRUMENTS, RECORDS, Effect, bend, draw, slosh
from problems.independent.manoeuvres import CONTROLS, flown, history
from problems.independent.motion import (
    ATTITUDE,
    STEP_S,
    SURFACES,
    Craft,
    Inputs,
    Loading,
    integrate,
    rotation_matrix,
)
from problems.independent.planes import JET, LIGHT, Plane
from problems.independent.sensors import Instruments, readings, recorded
from problems.independent.trim import Level, level_flight

_RATES_HZ = (25, 50)  # of the records; they divide the rate of the simulation
_STREAM = 4401  # of random numbers, this folder's own
_BANK = 1.1  # rad, beyond which no pilot lets a manoeuvre go
_ATTEMPTS = 10
_HALF_S = 0.5 * STEP_S


@dataclass(frozen=True, eq=False, kw_only=True)
class Plan:
    """Inputs of the records: `t` (M,) [s] in quarter steps up to the end of the longest record, control -> deviation
    (M, records) from trim, surfaces in radians, throttle as a part of its trim setting."""

    t: np.ndarray
    deviation: Mapping[str, np.ndarray]
    durations: tuple[float, ...]
    rate_hz: int
    noise: float
    seed: int

    @property
    def steps(self) -> int:
        return (len(self.t) - 1) // 4


@dataclass(frozen=True, eq=False, kw_only=True)
class Flown:
    """A set.

    records   name -> channel -> samples, with t;  level  trim of the healthy aircraft
    fit       of the tables along the healthy flights;  derivatives  what the aircraft file has of it
    effect    what is hidden; turbulence has the r.m.s. velocity that was met
    """

    plane: Plane
    records: Mapping[str, Mapping[str, np.ndarray]]
    level: Level
    fit: Fit
    derivatives: Mapping[str, Mapping[tuple[str, ...], float]]
    effect: Effect | None
    plan: Plan


def fly_set(case: str, seed: int, size: float = 1.0) -> Flown:
    """The set of a case and a seed; the two aircraft take turns. `size` is a factor on what is hidden.

    Raises ValueError for an unknown case, and when no draw can be flown.
    """
    if case not in CASES:
        raise ValueError(f"unknown case '{case}'; expected one of: {', '.join(CASES)}")
    number = CASES.index(case)
    plane = (LIGHT, JET)[(number + seed) % 2]
    for attempt in range(_ATTEMPTS):
        rng = np.random.default_rng([_STREAM, seed, number, attempt])
        plan = plan_of(plane, rng)
        healthy = healthy_craft(plane, len(RECORDS))
        level, log = fly(healthy, plan, None)
        points = variables(plane, plan, log)
        effect = draw(case, plane, points, rng)
        effect = None if effect is None else effect.scaled(size)
        if effect is not None and effect.kind not in INSTRUMENTS:
            _, log = fly(with_effect(healthy, effect), plan, effect)
        if _within(plan, log):
            return _set(plane, plan, (level, log), points, effect)
    raise ValueError(f"{case}, seed {seed}: no flyable set in {_ATTEMPTS} attempts; choose another seed")


def fly_effect(plane: Plane, seed: int, effect: Effect | None) -> Flown:
    """A set of an aircraft with a chosen effect, or with none; the seed draws inputs, noise and file."""
    plan = plan_of(plane, np.random.default_rng([_STREAM, seed]))
    healthy = healthy_craft(plane, len(RECORDS))
    level, log = fly(healthy, plan, None)
    points = variables(plane, plan, log)
    if effect is not None and effect.kind not in INSTRUMENTS:
        _, log = fly(with_effect(healthy, effect), plan, effect)
    return _set(plane, plan, (level, log), points, effect)


def _set(
    plane: Plane,
    plan: Plan,
    flown: tuple[Level, Mapping[str, np.ndarray]],
    points: Mapping[str, np.ndarray],
    effect: Effect | None,
) -> Flown:
    """What is recorded of a flight, with its file; `points` are the tables' variables along the healthy flight."""
    (level, log), fit = flown, fitted(plane, points)
    return Flown(
        plane=plane,
        records=_records(with_effect(healthy_craft(plane, len(RECORDS)), effect), plan, log, effect),
        level=level,
        fit=fit,
        derivatives=guessed(fit, np.random.default_rng([plan.seed, 1])),
        effect=_as_met(effect, plan, plane),
        plan=plan,
    )


def plan_of(plane: Plane, rng: np.random.Generator) -> Plan:
    """What the pilot does in the records of a set, how long they are, and how they are recorded."""
    durations = tuple(float(d) for d in rng.integers(25, 31, len(RECORDS)))
    t = np.arange(round(max(durations) / STEP_S) * 4 + 1) * 0.25 * STEP_S
    moves = [flown(name, duration, rng) for name, duration in zip(RECORDS, durations, strict=True)]
    amplitude = rng.uniform(0.85, 1.15)
    return Plan(
        t=t,
        deviation={
            name: np.stack(
                [history(t, one, name, amplitude * plane.size[name], plane.unit_s[name]) for one in moves], 1
            )
            for name in CONTROLS
        },
        durations=durations,
        rate_hz=int(rng.choice(_RATES_HZ)),
        noise=float(np.exp(rng.uniform(np.log(0.7), np.log(1.4)))),
        seed=int(rng.integers(2**31)),
    )


def healthy_craft(plane: Plane, records: int) -> Craft:
    """The aircraft with nothing hidden in it, loaded as its file says."""
    return Craft(plane=plane, loading=Loading(mass=np.full(records, plane.mass), cg=np.zeros((3, records))))


def with_effect(craft: Craft, effect: Effect | None) -> Craft:
    """The aircraft with what an effect changes of it."""
    if effect is None:
        return craft
    has = np.array([name in effect.records for name in RECORDS], dtype=float)
    loading = craft.loading
    if effect.kind == "mass":
        return replace(craft, loading=replace(loading, mass=loading.mass + effect.value * has))
    if effect.kind == "cg_offset":
        along = np.array([[float(axis == effect.target)] for axis in "xyz"])
        return replace(craft, loading=replace(loading, cg=loading.cg + effect.value * has * along))
    if effect.kind == "aero_term":
        assert effect.term is not None
        return replace(craft, extra={effect.target: ((effect.value, tuple(effect.term.split("*"))),)})
    if effect.kind == "fuel_slosh":
        return replace(craft, slosh=slosh(effect, craft.plane))
    if effect.kind == "wing_bending":
        return replace(craft, bend=bend(effect))
    return craft


def fly(craft: Craft, plan: Plan, effect: Effect | None) -> tuple[Level, dict[str, np.ndarray]]:
    """Trim, then all records side by side: what `integrate` logs, and the `servo` positions (steps + 1, surfaces, n).

    A gust blows along the body axis that it is named after, as that axis is when the gust begins. A flight without the
    gust gives the attitude there.
    """
    level = level_flight(craft)
    craft = craft.from_alpha(level.alpha)
    inputs, servo = _inputs(craft, plan, level, effect)
    log = integrate(craft, inputs, level.state, plan.steps)
    if effect is not None and effect.kind == "gust":
        inputs = replace(inputs, wind=_gusts(plan, effect, log))
        log = integrate(craft, inputs, level.state, plan.steps)
    return level, log | {"servo": servo[::2]}


def _inputs(craft: Craft, plan: Plan, level: Level, effect: Effect | None) -> tuple[Inputs, np.ndarray]:
    """What acts, and the servo positions (halves, surfaces, n)."""
    plane, count = craft.plane, len(RECORDS)
    at_rest = {"delta_e": level.elevator, "delta_a": np.zeros(count), "delta_r": np.zeros(count)}
    servo = {name: follow(at_rest[name] + plan.deviation[name], _HALF_S, *plane.servo) for name in SURFACES}
    throttle = spool(level.throttle * (1.0 + plan.deviation["throttle"]), _HALF_S, plane.spool_s)
    halves = len(throttle)
    wind, spin = np.zeros((2, halves, 3, count))
    loss = np.ones((halves, count))
    acting = dict(servo)
    if effect is not None:
        has = np.array([name in effect.records for name in RECORDS], dtype=float)
        if effect.kind in ("actuator_lag", "rate_limit", "backlash"):
            acting[effect.target] = linked(effect, servo[effect.target], has)
        if effect.kind == "effectiveness_change":
            assert effect.onset_s is not None
            onset = np.array([effect.onset_s.get(name, np.inf) for name in RECORDS])
            loss = 1.0 + effect.value * (plan.t[::2, None] >= onset)
        if effect.kind == "turbulence":
            wind, spin = _turbulence(plan, effect, plane)
    inputs = Inputs(surface=acting, throttle=throttle, loss=loss, wind=wind, spin=spin)
    return inputs, np.stack([servo[name] for name in SURFACES], axis=1)


def linked(effect: Effect, position: np.ndarray, has: np.ndarray) -> np.ndarray:
    """Positions of a surface behind a faulty linkage, from servo positions (halves, n); `has` (n,) is 1 for those."""
    if effect.kind == "actuator_lag":
        return lag(position, _HALF_S, effect.value * has)
    if effect.kind == "rate_limit":
        return limited(position, _HALF_S, np.where(has > 0.0, effect.value, np.inf))
    return played(position, effect.value * has)


def _turbulence(plan: Plan, effect: Effect, plane: Plane) -> tuple[np.ndarray, np.ndarray]:
    """Velocity and rotation of the air, (halves, 3, n) each, another weather in each record."""
    halves = (len(plan.t) + 1) // 2
    met = [
        air.turbulence(
            np.random.default_rng([plan.seed, 2, i]), halves, _HALF_S, effect.value, plane.V, plane.span, plane.tail_arm
        )
        for i in range(len(RECORDS))
    ]
    return np.stack([velocity for velocity, _ in met], axis=2), np.stack([rotation for _, rotation in met], axis=2)


def _gusts(plan: Plan, effect: Effect, log: Mapping[str, np.ndarray]) -> np.ndarray:
    """(halves, 3, n) velocity of the air, earth axes."""
    assert effect.onset_s is not None
    t = plan.t[::2]
    wind = np.zeros((len(t), 3, len(RECORDS)))
    for i, name in enumerate(RECORDS):
        if name in effect.onset_s:
            onset = effect.onset_s[name]
            quaternion = log["x"][round(onset / STEP_S), ATTITUDE, i : i + 1]
            axis = rotation_matrix(quaternion)["xyz".index(effect.target), :, 0]
            wind[:, :, i] = effect.value * air.gust(t, onset, effect.parameters["length"])[:, None] * axis
    return wind


def variables(plane: Plane, plan: Plan, log: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Variables of the tables along healthy flights, of the records as long as they are, one after another."""
    omega, V = log["x"][:, 10:13], log["V"]
    _, sound = air_at(-log["x"][:, 2])
    whole = {"alpha": log["alpha"], "beta": log["beta"], "mach": V / sound}
    whole |= {name: log["servo"][:, i] for i, name in enumerate(SURFACES)}
    lengths = {"p": plane.span, "q": plane.chord, "r": plane.span}
    whole |= {name: omega[:, i] * length / (2.0 * V) for i, (name, length) in enumerate(lengths.items())}
    ends = [round(duration / STEP_S) + 1 for duration in plan.durations]
    return {name: np.concatenate([x[:end:2, i] for i, end in enumerate(ends)]) for name, x in whole.items()}


def _within(plan: Plan, log: Mapping[str, np.ndarray]) -> bool:
    R = np.moveaxis(log["x"][:, ATTITUDE], 1, 0)
    bank = np.abs(np.arctan2(*rotation_matrix(R)[1:, 2]))
    ends = [round(duration / STEP_S) + 1 for duration in plan.durations]
    return all(bank[:end, i].max() < _BANK for i, end in enumerate(ends))


def _records(
    craft: Craft, plan: Plan, log: Mapping[str, np.ndarray], effect: Effect | None
) -> dict[str, dict[str, np.ndarray]]:
    every = round(1.0 / (STEP_S * plan.rate_hz))
    instruments = _instruments(effect)
    noise = {name: plan.noise * sigma for name, sigma in craft.plane.noise.items()}
    records = {}
    for i, (name, duration) in enumerate(zip(RECORDS, plan.durations, strict=True)):
        end = round(duration / STEP_S) + 1
        mine = {key: x[:end, ..., i] for key, x in log.items()}
        read = readings(mine, instruments, craft.loading.cg[:, i])
        read |= {surface: mine["servo"][:, k] for k, surface in enumerate(SURFACES)}
        rng = np.random.default_rng([plan.seed, 3, i])
        records[name] = recorded(read, np.arange(end) * STEP_S, every, noise, instruments, rng)
    return records


def _instruments(effect: Effect | None) -> Instruments:
    """Errors of the instruments are the same in all records."""
    if effect is None:
        return Instruments()
    one = {effect.target: effect.value}

    def of(kind: str) -> dict[str, float]:
        return one if effect.kind == kind else {}

    place = of("accelerometer_position")
    return Instruments(
        accelerometer=(place.get("x", 0.0), place.get("y", 0.0), place.get("z", 0.0)),
        delay_s=of("sensor_delay"),
        scale=of("sensor_scale"),
        bias=of("sensor_bias"),
    )


def _as_met(effect: Effect | None, plan: Plan, plane: Plane) -> Effect | None:
    """Turbulence has the r.m.s. velocity that was met, per axis; a spectrum only predicts it."""
    if effect is None or effect.kind != "turbulence":
        return effect
    velocity = _turbulence(plan, effect, plane)[0]
    ends = [round(duration / _HALF_S) + 1 for duration in plan.durations]
    met = np.concatenate([velocity[:end, :, i].ravel() for i, end in enumerate(ends)])
    return replace(effect, value=float(f"{np.sqrt(np.mean(met**2)):.4g}"))
