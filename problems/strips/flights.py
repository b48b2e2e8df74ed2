"""Fly a set: four records of one aircraft, three to fit and one to hold back, with what a case hides in them.

A third of the sets is flown in turbulence, uniform over the aircraft or with its gradients; a third each with prepared
inputs only, by a pilot and under an autopilot. The file is the linearisation of the strips at the trim point, by finite
differences, with the errors that it states.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from problems.independent.actuators import lag
from problems.independent.air import SCALE_M, across_path, along_path
from problems.independent.atmosphere import air_at
from problems.independent.motion import angles_of
from problems.strips.effects import CASES, RECORDS, Effect, draw
from problems.strips.forces import Flow, aerodynamics
from problems.strips.motion import STEP_S, Task, Trim, fly, trim
from problems.strips.pilots import WAYS
from problems.strips.planes import PLANES, SURFACES, Plane

UNCERTAINTY = 0.2  # stated in the file, and the 1-sigma of its errors
COEFFICIENTS = ("CL", "CD", "CY", "Cl", "Cm", "Cn")
AIR_DATA = ("V", "alpha", "beta")
_STREAM = 5507
_RATE_HZ = 50
_AIR_EVERY = (2, 3, 5)  # samples from one reading of the air data to the next
_ATTEMPTS = 12
_MOST = {"phi": 1.0, "theta": 0.5, "alpha": 0.2, "beta": 0.25}  # rad from trim, beyond which nobody flies on
_STOPS = 0.6  # rad: no surface goes farther
_SHAPES = {
    "3211": ((1.0, 3.0), (-1.0, 2.0), (1.0, 1.0), (-1.0, 1.0)),
    "doublet": ((1.0, 1.5), (-1.0, 1.5)),
    "step": ((1.0, 8.0),),
}
_CARDS = {
    "m1": (("delta_e", "3211", 1), ("throttle", "step", 1), ("delta_r", "doublet", 1), ("delta_a", "doublet", 1)),
    "m2": (("delta_r", "doublet", -1), ("delta_e", "doublet", -1), ("delta_a", "doublet", 1), ("throttle", "step", -1)),
    "m3": (("delta_a", "doublet", -1), ("delta_e", "3211", -1), ("delta_r", "doublet", 1), ("delta_a", "doublet", 1)),
    "m4": (("delta_e", "doublet", 1), ("delta_r", "doublet", -1), ("throttle", "step", 1), ("delta_a", "doublet", -1)),
}
# products of variables that strips may have and a straight line has not
_CURVED = ("alpha*alpha", "beta*beta", "alpha*beta", "alpha*p", "alpha*r", "alpha*q", "alpha*alpha*alpha", "beta*p")
_CURVED += ("Tc", "Tc*delta_e", "Tc*delta_r", "Tc*beta", "Tc*alpha", "Tc*r", "alpha*delta_a", "delta_e*delta_e", "V")
_CURVED += ("alpha*delta_e", "beta*beta*beta", "beta*r", "p*r", "mach", "alphadot", "betadot")


@dataclass(frozen=True, eq=False, kw_only=True)
class Flown:
    """A set: name -> channel -> samples, with t; values at the trim point and what the file has of them; what is true
    of strips and not in the file, (coefficient, term)."""

    plane: Plane
    level: Trim
    records: Mapping[str, Mapping[str, np.ndarray]]
    values: Mapping[str, float]
    given: Mapping[str, float]
    effects: tuple[Effect, ...]
    curved: tuple[tuple[str, str], ...]
    left: Mapping[str, float]
    conditions: Mapping[str, object]


def fly_set(case: str, seed: int) -> Flown:
    """The set of a case and a seed. ValueError for an unknown case, and when no draw can be flown."""
    if case not in CASES:
        raise ValueError(f"unknown case '{case}'; expected one of: {', '.join(CASES)}")
    number = CASES.index(case)
    plane, way = PLANES[(number + seed) % 3], WAYS[(number // 3 + seed) % 3]
    turbulent = (number // 9 + number + seed) % 3 == 0
    level = trim(plane)
    for attempt in range(_ATTEMPTS):
        rng = np.random.default_rng([_STREAM, seed, number, attempt])
        effects = draw(case, plane, rng)
        weather = str(rng.choice(("uniform", "with gradients"))) if turbulent else "calm"
        # what moves an aircraft far from trim is not flown without anybody at the controls
        flown_by = way if attempt < _ATTEMPTS // 2 else "autopilot"
        task, durations = _task(plane, flown_by, weather, rng)
        healthy = fly(plane, level, replace(task, air=0.0 * task.air, gradient=0.0 * task.gradient), ())
        log = fly(plane, level, task, effects) if effects or turbulent else healthy
        if all(_within(level, one, durations) for one in (healthy, log)):
            return _set(plane, level, log, effects, (healthy, durations, flown_by, weather, rng))
    raise ValueError(f"{case}, seed {seed}: no flyable set in {_ATTEMPTS} attempts; choose another seed")


def _task(plane: Plane, way: str, weather: str, rng: np.random.Generator) -> tuple[Task, tuple[float, ...]]:
    durations = tuple(float(d) for d in rng.integers(24, 30, len(RECORDS)))
    t = np.arange(round(max(durations) / STEP_S) + 1) * STEP_S
    moves = {name: np.zeros((len(t), len(RECORDS))) for name in (*SURFACES, "throttle")}
    for i, (name, duration) in enumerate(zip(RECORDS, durations, strict=True)):
        slot = (duration - 3.0) / len(_CARDS[name])
        for k, (control, shape, sign) in enumerate(_CARDS[name]):
            times, places, now = [0.0], [0.0], 1.5 + slot * k + rng.uniform(0.0, 0.6)
            times.append(now)
            places.append(0.0)
            for place, units in _SHAPES[shape]:
                long = units * (1.0 if control == "throttle" else plane.unit_s) * rng.uniform(0.9, 1.1)
                times += [now + 0.12, now + long]
                places += [sign * place * rng.uniform(0.85, 1.15)] * 2
                now += long
            moves[control][:, i] += plane.size[control] * np.interp(t, [*times, now + 0.12], [*places, 0.0])
    seed = int(rng.integers(2**31))
    air, gradient = _weather(plane, weather, len(t), seed)
    return Task(
        inputs=np.stack([moves[name] for name in SURFACES], axis=1),
        throttle=moves["throttle"],
        air=air,
        gradient=gradient,
        delayed=weather == "with gradients",
        way=way,
        seed=seed,
    ), durations


def _weather(plane: Plane, weather: str, count: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """(count, 3, records) of Dryden's spectra: velocity, and its gradient over the span: that of w is of the rolling
    gust of MIL-F-8785C, that of u a third of it."""
    air, gradient = np.zeros((2, count, 3, len(RECORDS)))
    if weather == "calm":
        return air, gradient
    span = plane.wing[0]
    for i in range(len(RECORDS)):
        rng = np.random.default_rng([seed, 2, i])
        sigma, T = 0.008 * plane.V * rng.uniform(0.8, 1.3), SCALE_M / plane.V
        air[:, 0, i] = along_path(rng, count, STEP_S, sigma, T)
        air[:, 1, i], air[:, 2, i] = (across_path(rng, count, STEP_S, sigma, T) for _ in "vw")
        if weather == "uniform":
            continue
        rolls = 4.0 * span / (np.pi * plane.V)
        size = sigma * np.sqrt(0.8 * (np.pi * SCALE_M / (4.0 * span)) ** (1 / 3) / (SCALE_M * plane.V) / (2.0 * rolls))
        for axis, part in ((2, 1.0), (0, 0.33)):
            gradient[:, axis, i] = along_path(rng, count, STEP_S, part * size, rolls)
    return air, gradient


def _within(level: Trim, log: Mapping[str, np.ndarray], durations: Sequence[float]) -> bool:
    phi, theta, _ = angles_of(np.moveaxis(log["x"][:, 6:10], 1, 0))
    beside = {"phi": phi, "theta": theta - level.alpha, "alpha": log["alpha"] - level.alpha, "beta": log["beta"]}
    ends = [round(duration / STEP_S) + 1 for duration in durations]
    stops = all(np.abs(log["servo"][:end, :, i]).max() < _STOPS for i, end in enumerate(ends))
    return stops and all(
        np.abs(x[:end, i]).max() < _MOST[name] for name, x in beside.items() for i, end in enumerate(ends)
    )


def _set(plane: Plane, level: Trim, log: Mapping[str, np.ndarray], effects: tuple[Effect, ...], how) -> Flown:
    healthy, durations, way, weather, rng = how
    values = linearised(plane, level)
    given = {}
    for name, value in values.items():
        off = UNCERTAINTY * float(np.clip(rng.standard_normal(), -2.0, 2.0))
        if abs(value) > 1e-4:
            given[name] = float(f"{value * (1.0 + off):.3g}")
    curved, left = _beyond(plane, healthy, durations)
    every, level_of_noise = int(rng.choice(_AIR_EVERY)), float(rng.uniform(0.7, 1.4))
    records = {}
    for i, (name, duration) in enumerate(zip(RECORDS, durations, strict=True)):
        end = round(duration / STEP_S) + 1
        mine = {key: x[:end, ..., i] for key, x in log.items()}
        mine |= {"t": np.arange(end) * STEP_S, "cg": np.zeros(3)}
        for one in effects:
            if one.kind == "cg_offset" and name in one.records:
                mine["cg"]["xyz".index(one.target)] += one.value
        records[name] = _recorded(plane, mine, [e for e in effects if name in e.records], every, level_of_noise, rng)
    return Flown(
        plane=plane,
        level=level,
        records=records,
        values=values,
        given=given,
        effects=effects,
        curved=curved,
        left=left,
        conditions={
            "rate_hz": _RATE_HZ,
            "air_data_hz": round(_RATE_HZ / every, 2),
            "noise": level_of_noise,
            "durations_s": durations,
            "flown_by": way,
            "air": weather,
        },
    )


def coefficients(plane: Plane, level: Trim, at: Mapping[str, float]) -> dict[str, float]:
    """CL CD CY Cl Cm Cn of the strips in steady flow, at the thrust of trim; `at` has deviations from trim: alpha and
    beta, surfaces [rad], p and r times half the span and q times half the chord, over V."""
    span, chord = plane.wing[:2]
    alpha, beta = level.alpha + at.get("alpha", 0.0), at.get("beta", 0.0)
    lengths = {"p": 0.5 * span, "q": 0.5 * chord, "r": 0.5 * span}
    direction = np.array([np.cos(alpha) * np.cos(beta), np.sin(beta), np.sin(alpha) * np.cos(beta)])
    rho = air_at(np.array([plane.altitude]))[0]
    flow = Flow(
        velocity=plane.V * direction[:, None],
        omega=np.array([[at.get(name, 0.0) * plane.V / length] for name, length in lengths.items()]),
        surface=np.array([[level.surface[i] + at.get(name, 0.0)] for i, name in enumerate(SURFACES)]),
        thrust=np.array([level.thrust]),
        rho=rho,
    )
    force, moment, _ = aerodynamics(plane, flow)
    scale = 0.5 * rho[0] * plane.V**2 * plane.area
    body = np.concatenate([force[:, 0], moment[:, 0] / np.array([span, chord, span])]) / scale
    return dict(zip(COEFFICIENTS, _in_wind_axes(body, alpha), strict=True))


def _in_wind_axes(body: np.ndarray, alpha: np.ndarray | float) -> np.ndarray:
    """CL CD CY Cl Cm Cn along the first axis, from CX CY CZ and moments."""
    X, Y, Z, *moments = body
    sin, cos = np.sin(alpha), np.cos(alpha)
    return np.array([X * sin - Z * cos, -X * cos - Z * sin, Y, *moments])


def linearised(plane: Plane, level: Trim) -> dict[str, float]:
    """Constants and derivatives of a file, by central differences at the trim point."""
    at = {"alpha": level.alpha, **dict(zip(SURFACES, level.surface, strict=True))}
    found = {}
    trimmed = coefficients(plane, level, {})
    slopes = {}
    for variable in ("alpha", "beta", "p", "q", "r", *SURFACES):
        step = 0.02 if variable in ("alpha", "beta", *SURFACES) else 0.005
        high, low = (coefficients(plane, level, {variable: s * step}) for s in (1.0, -1.0))
        slopes[variable] = {c: (high[c] - low[c]) / (2.0 * step) for c in COEFFICIENTS}
    for c in COEFFICIENTS:
        lateral = c in ("CY", "Cl", "Cn")
        mine = ("beta", "p", "r", "delta_a", "delta_r") if lateral else ("alpha", "q", "delta_e")
        constant = trimmed[c] - sum(slopes[v][c] * at.get(v, 0.0) for v in mine)
        found |= {f"{c}_0": constant, **{f"{c}_{v}": slopes[v][c] for v in mine}}
    return {name: float(value) for name, value in found.items()}


def _beyond(
    plane: Plane, log: Mapping[str, np.ndarray], durations: Sequence[float]
) -> tuple[tuple[tuple[str, str], ...], dict[str, float]]:
    """Terms that a linear file lacks of the strips along a healthy flight in calm air, and what straight lines leave of
    each coefficient, of its variation. A term counts when it takes a fifth of what is left, a fiftieth of all."""
    ends = [round(duration / STEP_S) + 1 for duration in durations]

    def joined(x: np.ndarray) -> np.ndarray:
        return np.concatenate([x[:end:4, ..., i] for i, end in enumerate(ends)])

    span, chord = plane.wing[:2]
    V, alpha = joined(log["V"]), joined(log["alpha"])
    one = {"alpha": alpha, "beta": joined(log["beta"]), "V": V / plane.V - 1.0, "mach": V}
    one |= {
        n: joined(log["x"][:, 10 + i]) * x / 2.0 / V
        for i, (n, x) in enumerate(zip("pqr", (span, chord, span), strict=True))
    }
    one |= {name: joined(log["acting"][:, i]) for i, name in enumerate(SURFACES)}
    one["Tc"] = joined(log["thrust"]) / (0.5 * joined(log["rho"]) * V**2 * plane.area)
    for name, length in (("alpha", chord), ("beta", span)):
        one[f"{name}dot"] = joined(np.gradient(log[name], STEP_S, axis=0)) * length / 2.0 / V
    body = np.moveaxis(joined(log["coefficients"]), 1, 0)
    linear = np.stack([np.ones_like(V), *(one[v] for v in ("alpha", "beta", "p", "q", "r", *SURFACES))], axis=1)
    found, left = [], {}
    for name, y in zip(COEFFICIENTS, _in_wind_axes(body, alpha), strict=True):
        rest = y - linear @ np.linalg.lstsq(linear, y, rcond=None)[0]
        left[name] = float(f"{np.std(rest) / np.std(y):.3g}")
        for term in _CURVED:
            new = np.prod([one[v] for v in term.split("*")], axis=0)
            new = new - linear @ np.linalg.lstsq(linear, new, rcond=None)[0]
            takes = new * (new @ rest) / (new @ new)
            if takes @ takes > max(0.04 * rest @ rest, 4e-4 * np.sum((y - y.mean()) ** 2)):
                found.append((name, term))
    return tuple(found), left


def _recorded(
    plane: Plane,
    log: Mapping[str, np.ndarray],
    effects: Sequence[Effect],
    air_every: int,
    level_of_noise: float,
    rng: np.random.Generator,
) -> dict[str, np.ndarray]:
    """Channel -> samples of one record: what instruments read where they stand, with their errors, noise and steps."""
    read = _read(log, effects)
    t, every = log["t"], round(1.0 / STEP_S / _RATE_HZ)
    samples = {"t": np.round(t[::every], 6), "rho": read["rho"][::every]}
    for name, sigma in plane.noise.items():
        x = read[name]
        for one in effects:
            if one.kind == "sensor_delay" and (one.target == name or one.target == "air_data" and name in AIR_DATA):
                x = np.interp(t - one.value, t, x)
            if one.target == name:
                x = _wrong(one, t, x)
        unit = float(np.mean(x)) if name == "thrust" else 1.0
        x = x[::every] + level_of_noise * sigma * unit * rng.standard_normal(len(samples["t"]))
        x = np.round(x / (plane.steps[name] * unit)) * plane.steps[name] * unit
        if name in AIR_DATA:
            x[np.arange(len(x)) % air_every > 0] = np.nan
        samples[name] = x
    return samples


def _wrong(one: Effect, t: np.ndarray, x: np.ndarray) -> np.ndarray:
    if one.kind == "sensor_bias":
        return x + one.value
    if one.kind == "sensor_scale":
        return (1.0 + one.value) * x
    if one.kind == "sensor_drift":
        return x + one.value * 0.5 * (1.0 - np.cos(2.0 * np.pi * t / one.parameters["period_s"]))
    return lag(x, STEP_S, np.array(one.value)) if one.kind == "sensor_lag" else x


def _read(log: Mapping[str, np.ndarray], effects: Sequence[Effect]) -> dict[str, np.ndarray]:
    omega, turning, velocity = log["x"][:, 10:13], log["turning"], log["air"]
    place, vane = np.zeros(3), {"alpha": 0.0, "beta": 0.0}
    for one in effects:
        if one.kind == "accelerometer_position":
            place["xyz".index(one.target)] += one.value
        if one.kind == "vane_position":
            vane[one.target] += one.value
    arm = place - log["cg"]
    force = log["force"] + np.cross(turning, arm) + np.cross(omega, np.cross(omega, arm))
    phi, theta, psi = angles_of(log["x"][:, 6:10].T)
    at = {name: (velocity + np.cross(omega, np.array([x, 0.0, 0.0]))).T for name, x in vane.items()}
    return {
        "V": log["V"],
        "alpha": np.arctan2(at["alpha"][2], at["alpha"][0]),
        "beta": np.arcsin(at["beta"][1] / np.sqrt(np.sum(at["beta"] ** 2, axis=0))),
        **dict(zip("pqr", omega.T, strict=True)),
        **{"phi": phi, "theta": theta, "psi": np.unwrap(psi)},
        **dict(zip(("ax", "ay", "az"), force.T, strict=True)),
        **dict(zip(("pdot", "qdot", "rdot"), turning.T, strict=True)),
        **dict(zip(SURFACES, log["servo"].T, strict=True)),
        **{"thrust": log["thrust"], "rho": log["rho"], "altitude": -log["x"][:, 2]},
    }
