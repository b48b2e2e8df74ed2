"""A blind aircraft that casid flies, with effects of its own vocabulary, at four times the recorded rate or more.

So truth and estimate do not share a step."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import casadi as ca
import numpy as np
import scipy
from scipy import signal

from casid.errors import InputError
from casid.model.aircraft import Aircraft, EffectValue
from casid.model.dynamics import aircraft_model
from casid.model.effects import effect_of
from casid.model.flown_records import FlownRecords, flown_records
from casid.model.operators import TURNING
from casid.model.path import OUTPUTS
from casid.model.simulate import simulate
from casid.model.trim import Trim
from casid.records.record import Record
from casid.signals import SURFACES
from problems.blind.case import Hidden
from problems.blind.outside import SIGNALS, Outside, along

FLOWN_HZ = 200.0
_PICARD, _SETTLED = 25, 1e-7


@dataclass(frozen=True, eq=False, kw_only=True)
class Flown:
    """An aircraft as casid flies it.

    aircraft      healthy and exact, with its trim point
    level         the steady flight from which every record begins;  span  [m] of its wing
    sizes         of inputs: surfaces [rad], throttle as a fraction of the trim thrust;  units_s  their time units
    augmentation  surface -> state -> gain [rad per unit of the state]: what a stability augmentation adds to the input
    """

    aircraft: Aircraft
    level: Trim
    span: float
    sizes: Mapping[str, float]
    units_s: Mapping[str, float]
    augmentation: Mapping[str, Mapping[str, float]] = field(default_factory=dict)

    @cached_property
    def _closed_loop(self) -> ca.Function:
        """One step of the healthy aircraft: state, deviations of the controls -> next state, controls. The augmentation
        sees the state at the beginning of the step and holds its surfaces over it."""
        model, level = aircraft_model(self.aircraft), self.level
        f = ca.Function("f", [model.x, model.u, model.p, model.w], [model.f])
        x, d = ca.SX.sym("x", len(model.states)), ca.SX.sym("d", len(model.inputs))
        away = x - level.state
        added = [
            sum(gain * away[model.states.index(state)] for state, gain in self.augmentation.get(name, {}).items())
            for name in model.inputs
        ]
        u = ca.vertcat(*(level.inputs[name] for name in model.inputs)) + d + ca.vertcat(*added)
        p, calm, dt = model.nominal_vector(), np.zeros(len(model.disturbances)), 1.0 / FLOWN_HZ
        k1 = f(x, u, p, calm)
        k2 = f(x + 0.5 * dt * k1, u, p, calm)
        k3 = f(x + 0.5 * dt * k2, u, p, calm)
        k4 = f(x + dt * k3, u, p, calm)
        return ca.Function("step", [x, d], [x + dt / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4), u])

    def augmented(self, deviations: Mapping[str, np.ndarray]) -> Mapping[str, np.ndarray]:
        """Deviations of the controls from trim with what the augmentation adds in the healthy flight at FLOWN_HZ. A
        flight with a hidden effect is flown with the same surfaces: an augmentation that follows what it changes would
        hide it from nobody, and need as many flights as samples."""
        if not self.augmentation:
            return deviations
        level, inputs = self.level, aircraft_model(self.aircraft).inputs
        thrust = level.thrust * deviations["throttle"]
        given = {**{name: deviations[name] for name in SURFACES}, "thrust": thrust, "rho": np.zeros_like(thrust)}
        d = np.stack([given[name] for name in inputs])
        step = self._closed_loop.mapaccum(d.shape[1])
        _, u = step(level.state, d)
        added = u.full() - np.array([[level.inputs[name]] for name in inputs])
        return {**deviations, **{name: added[inputs.index(name)] for name in SURFACES}}

    def fly(
        self,
        name: str,
        t: np.ndarray,
        deviations: Mapping[str, np.ndarray],
        hidden: Sequence[Hidden] = (),
        outside: Outside | None = None,
        seed: int = 0,
    ) -> Record:
        """One record at FLOWN_HZ, without noise: outputs, commanded surfaces, thrust, density.

        deviations  of the controls from trim, (N,) each; the throttle as a fraction of the trim thrust
        outside     acts in this record beside `hidden`;  seed  of the turbulence
        Raises InputError when the motion diverges.
        """
        deviations = self.augmented(deviations)
        here = [one for one in hidden if name in one.records]
        values = [effect_value(one) for one in here if one.kind != "turbulence"]
        instruments = [value for value in values if effect_of(value).output is not None]
        aircraft = self.aircraft.with_effects([value for value in values if value not in instruments])
        record = self._commanded(name, t, deviations, self.level.inputs)
        start, at_trim = self._trimmed(flown_records(aircraft, [record], outputs=OUTPUTS))
        applied = flown_records(aircraft, [self._commanded(name, t, deviations, at_trim)], outputs=OUTPUTS)
        gusts = dict[str, np.ndarray]()
        for one in here:
            if one.kind == "turbulence":
                gusts = self.air(t, one.value, seed)
        if any(one.kind in ("wind_shear", "gust") for one in here):
            in_truth = self.aircraft.with_effects([v for v in aircraft.effects if not v.kind.startswith("sensor_")])
            record = _with_attitude(in_truth, applied.records[0], start, gusts, outside)
            applied = flown_records(aircraft, [record], outputs=OUTPUTS)
        outputs = _flown(applied, start, gusts, outside)
        read = dict(applied.records[0].channels) | dict(zip(OUTPUTS, outputs.T, strict=True))
        for value in instruments:
            effect = effect_of(value)
            assert effect.output is not None
            read |= effect.output(t, read, {"value": value.value, **value.parameters})
        return Record(name=name, t=t, channels=read)

    def air(self, t: np.ndarray, sigma: float, seed: int) -> dict[str, np.ndarray]:
        """The turbulence of the flight with that seed, see `turbulence`."""
        return turbulence(np.random.default_rng([seed, 3]), t, sigma, self.level.V, self.span)

    def _commanded(
        self, name: str, t: np.ndarray, deviations: Mapping[str, np.ndarray], at_trim: Mapping[str, float]
    ) -> Record:
        channels = {key: at_trim[key] + deviations[key] for key in SURFACES}
        channels["thrust"] = at_trim["thrust"] + self.level.thrust * deviations["throttle"]
        return Record(name=name, t=t, channels={**channels, "rho": np.full_like(t, at_trim["rho"])})

    def _trimmed(self, applied: FlownRecords) -> tuple[np.ndarray, dict[str, float]]:
        """Level flight at the trim speed and density with the effects of the file in force: state and inputs."""
        model, level = applied.model, self.level
        f = ca.Function("f", [model.x, model.u, model.p, model.w], [model.f])
        p, calm = model.nominal_vector(), np.zeros(len(model.disturbances))
        fixed = {name: float(applied.records[0][name][0]) for name in model.inputs}

        def at(z: np.ndarray) -> tuple[np.ndarray, dict[str, float]]:
            alpha, phi, *surfaces, thrust = z.tolist()
            controls = fixed | dict(zip(SURFACES, surfaces, strict=True)) | {"thrust": level.thrust * thrust}
            return np.array(
                [level.V * np.cos(alpha), 0.0, level.V * np.sin(alpha), 0.0, 0.0, 0.0, phi, alpha]
            ), controls

        def imbalance(z: np.ndarray) -> np.ndarray:
            x, controls = at(z)
            return f(x, [controls[name] for name in model.inputs], p, calm).full()[:6, 0]

        solution = scipy.optimize.root(imbalance, np.array([level.alpha, 0.0, level.delta_e, 0.0, 0.0, 1.0]), tol=1e-12)
        if np.abs(imbalance(solution.x)).max() > 1e-6:
            raise InputError(f"{self.aircraft.name} with a hidden effect has no steady flight ({solution.message})")
        return at(solution.x)


def _with_attitude(
    aircraft: Aircraft, record: Record, start: np.ndarray, gusts: Mapping[str, np.ndarray], outside: Outside | None
) -> Record:
    """The record with the attitude in which the aircraft meets a wind that stays where it is, over the ground."""
    before = np.zeros(0)
    for _ in range(_PICARD + 1):
        outputs = _flown(flown_records(aircraft, [record], outputs=OUTPUTS), start, gusts, outside)
        record = record.with_channels(**{key: outputs[:, OUTPUTS.index(key)] for key in TURNING})
        if len(before) and np.abs(outputs - before).max() < _SETTLED * np.abs(outputs).max():
            break
        before = outputs
    return record


def effect_value(hidden: Hidden) -> EffectValue:
    """The entry of an aircraft file."""
    onsets = {r: (at, at) for r, at in hidden.onset_s.items()} if hidden.onset_s else None
    parameters = {k: v for k, v in hidden.parameters.items() if k != "share"}
    return EffectValue(
        kind=hidden.kind,
        target=hidden.target,
        term=hidden.term,
        value=hidden.value,
        records=hidden.records,
        onset_s=onsets,
        parameters=parameters,
    )


def _flown(
    applied: FlownRecords, start: np.ndarray, gusts: Mapping[str, np.ndarray], outside: Outside | None
) -> np.ndarray:
    """(N, outputs). An effect outside the catalogue follows the motion that it changes: by iteration."""
    record = applied.records[0]
    flown = simulate(applied.model, record, start, disturbances=dict(gusts))
    if outside is None:
        return flown.outputs
    for _ in range(_PICARD):
        seen = {name: flown.output(name) for name in SIGNALS}
        acting = {f"d{name}": series for name, series in along(outside, record.t, seen).items()}
        again = simulate(applied.model, record, start, disturbances={**gusts, **acting})
        change = np.abs(again.states - flown.states).max()
        flown = again
        if change < _SETTLED * np.abs(flown.states).max():
            return flown.outputs
    raise InputError(
        f"{applied.aircraft.name}: the motion under '{outside.kind}' does not settle; choose a smaller size"
    )


def turbulence(rng: np.random.Generator, t: np.ndarray, sigma: float, V: float, span: float) -> dict[str, np.ndarray]:
    """Dryden turbulence (MIL-F-8785C, above 2000 ft: L = 533 m): velocity [m/s] and rotation [rad/s] of the air,
    r.m.s. velocity `sigma` per axis, (N,) each by disturbance station."""
    dt, L = float(t[1] - t[0]), 533.0
    lead = int(200.0 / dt)  # some 50 time constants: stationary when the record begins

    def filtered(numerator: Sequence[float], denominator: Sequence[float]) -> np.ndarray:
        white = rng.standard_normal(lead + len(t)) / np.sqrt(dt)
        b, a = signal.bilinear(numerator, denominator, 1.0 / dt)
        return np.asarray(signal.lfilter(b, a, white))[lead:]

    T = L / V
    longitudinal = sigma * np.sqrt(2.0 * T) * filtered([1.0], [T, 1.0])
    across = [sigma * np.sqrt(T) * filtered([np.sqrt(3.0) * T, 1.0], [T**2, 2.0 * T, 1.0]) for _ in "yz"]
    roll_T = 4.0 * span / (np.pi * V)
    roll = sigma * np.sqrt(0.8 * (np.pi * L / (4.0 * span)) ** (1.0 / 3.0) / (L * V)) * filtered([1.0], [roll_T, 1.0])
    pitch_T, yaw_T = 4.0 * span / (np.pi * V), 3.0 * span / (np.pi * V)
    rate = [_rate(w, V, T_, dt) for w, T_ in ((across[1], pitch_T), (across[0], yaw_T))]
    return {
        "wind_x": longitudinal,
        "wind_y": across[0],
        "wind_z": across[1],
        "gust_p": roll,
        "gust_q": -rate[0],
        "gust_r": rate[1],
    }


def _rate(w: np.ndarray, V: float, time_constant: float, dt: float) -> np.ndarray:
    """Rotation of the air from the gradient of a velocity along the path."""
    b, a = signal.bilinear([1.0 / V, 0.0], [time_constant, 1.0], 1.0 / dt)
    return np.asarray(signal.lfilter(b, a, w - w[0]))
