"""A manoeuvre flown by a simulation, from the measured initial state and with the inputs of flight."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from casid.acceptance.conditions import TRIM_TOLERANCE
from casid.acceptance.manoeuvres import Window
from casid.acceptance.smoothing import Smooth, smooth
from casid.acceptance.tolerances import CALIBRATED, StandardTest
from casid.errors import InputError
from casid.filtering.initial_state import state_of_outputs
from casid.model.aircraft import Aircraft
from casid.model.dynamics import standard_density
from casid.model.flown_records import FlownRecords, flown_records
from casid.model.measured_force import force_inputs
from casid.model.path import INTEGRALS
from casid.model.simulate import simulate
from casid.model.system import Model
from casid.records.record import Record

DIRECT = ("V", "alpha", "beta", "p", "q", "r", "phi", "theta", "psi", "altitude")  # channels that measure a state
# surface [rad] per attitude [rad], and per rate [rad/s]
_ATTITUDE_GAIN = 0.3
_RATE_GAIN = 0.3
_LOOPS: Mapping[str, tuple[str | None, str]] = {
    "delta_e": ("theta", "q"),
    "delta_a": ("phi", "p"),
    "delta_r": (None, "r"),
}  # surface -> (attitude, rate); its largest correction is the tolerance of its trim position


@dataclass(frozen=True, eq=False, kw_only=True)
class Flown:
    """Simulation of a manoeuvre."""

    channels: Mapping[str, np.ndarray]  # name -> (N,) as the instruments would read it; empty when it diverged
    # surface -> (N,) what a closed-loop controller added [rad]; empty for open loop
    corrections: Mapping[str, np.ndarray]
    diverged: str = ""  # where and why it left the range of numbers; "": it did not


def _outputs(record: Record, axes: str, wanted: Collection[str]) -> tuple[str, ...]:
    """Measured channels that a model of these axes gives: those of its state, and those that are compared."""
    given = {
        "full": (*DIRECT, "ax", "ay", "az", "pdot", "qdot", "rdot"),
        "longitudinal": ("V", "alpha", "q", "theta", "altitude", "ax", "az", "qdot"),
        "lateral": ("beta", "p", "r", "phi", "psi", "ay", "pdot", "rdot"),
    }[axes]
    asked = [name for name in given if name in wanted or (name in DIRECT and name not in INTEGRALS)]
    return tuple(name for name in asked if name in record and np.isfinite(record[name]).any())


@dataclass(frozen=True, eq=False, kw_only=True)
class ToFly:
    """A record, its smoothed channels, and the tests that it shows, each in a window."""

    record: Record
    smoothed: Mapping[str, Smooth]
    axes: str
    chosen: Sequence[tuple[StandardTest, Window]]

    @property
    def model(self) -> tuple:
        """Records that have the same fly the same model."""
        record = self.record
        wanted = {"V" if name == CALIBRATED else name for test, _ in self.chosen for name in test.channels}
        return self.axes, _outputs(record, self.axes, wanted), record.dt, force_inputs([record])


def fly(aircraft: Aircraft, flights: Sequence[ToFly], closed: bool) -> list[dict[Window, Flown]]:
    """Simulate every window of each flight, once for all its tests; `closed`: with the controller of `_LOOPS`."""
    applied: dict[tuple, FlownRecords] = {}
    for model in {one.model: None for one in flights}:
        axes, outputs, *_ = model
        applied[model] = flown_records(aircraft, [one.record for one in flights if one.model == model], axes, outputs)
    ready = {model: iter(one.records) for model, one in applied.items()}
    return [_flown(applied[one.model], next(ready[one.model]), one, closed) for one in flights]


def _flown(applied: FlownRecords, ready: Record, flight: ToFly, closed: bool) -> dict[Window, Flown]:
    """`ready`: its record made ready for the model."""
    record = flight.record
    measured = {
        name: flight.smoothed[name].curve
        if np.array_equal(ready[name], record[name], equal_nan=True)
        else smooth(ready.t, ready[name]).curve
        for name in DIRECT
        if name in record and name in applied.model.outputs
    }
    followed = ready.with_channels(**measured)
    windows = dict.fromkeys(window for _, window in flight.chosen)
    return {window: _fly(applied, followed, tuple(measured), window, closed) for window in windows}


def _fly(applied: FlownRecords, followed: Record, measured: Sequence[str], window: Window, closed: bool) -> Flown:
    """`followed`: the record made ready for the model, its `measured` channels smoothed."""
    model = applied.model
    ready = window.part_of(followed)
    begins = {name: float(ready[name][0]) for name in measured}
    start = state_of_outputs(model, ready, begins, model.guess(ready)[0])
    law = None
    try:
        if closed:
            model, ready, law = _with_controller(model, ready, start)
        flown = simulate(model, ready, start)
    except InputError as fault:
        return Flown(channels={}, corrections={}, diverged=str(fault))
    channels = {name: flown.outputs[:, i] for i, name in enumerate(model.outputs)}
    corrections = {} if law is None else _corrections(law, model, flown.states, ready)
    return Flown(channels=channels, corrections=corrections)


def _with_controller(model: Model, record: Record, start: np.ndarray) -> tuple[Model, Record, ca.Function]:
    """The model with small corrections of its surfaces towards the measured attitude and rates, signed as a surface
    acts on its rate at the start; the record with these as inputs, and the law (x, u) -> corrections."""
    loops = {
        s: loop for s, loop in _LOOPS.items() if s in model.inputs and loop[1] in model.states and loop[1] in record
    }
    followed = dict.fromkeys(
        name for loop in loops.values() for name in loop if name in model.states and name in record
    )
    aims = {name: ca.SX.sym(f"flight {name}") for name in followed}
    control = ca.Function("control", [model.x, model.u, model.p, model.w], [ca.jacobian(model.f, model.u)])
    at_start = record.matrix(model.inputs)[0]
    effect = control(start, at_start, model.nominal_vector(), np.zeros(len(model.disturbances))).full()
    laws = []
    corrected = ca.SX(model.u)
    for surface, (attitude, rate) in loops.items():
        most = TRIM_TOLERANCE[surface]
        column = model.inputs.index(surface)
        sign = float(np.sign(effect[model.states.index(rate), column]))
        law = sign * _RATE_GAIN * (aims[rate] - model.x[model.states.index(rate)])
        if attitude in aims:
            law += sign * _ATTITUDE_GAIN * (aims[attitude] - model.x[model.states.index(attitude)])
        laws.append(ca.fmin(ca.fmax(law, -most), most))
        corrected[column] = model.u[column] + laws[-1]
    u = ca.vertcat(model.u, *aims.values())
    f, h = ca.substitute([model.f, model.h], [model.u], [corrected])
    added = {f"flight {name}": record[name] for name in aims}
    steered = replace(model, inputs=(*model.inputs, *added), u=u, f=f, h=h, equation=None)
    return steered, record.with_channels(**added), ca.Function("law", [model.x, u], laws, ["x", "u"], list(loops))


def _corrections(law: ca.Function, model: Model, states: np.ndarray, record: Record) -> dict[str, np.ndarray]:
    found = law.map(len(record)).call([states.T, record.matrix(model.inputs).T])
    return {name: one.full()[0] for name, one in zip(law.name_out(), found, strict=True)}


def calibrated_airspeed(V: np.ndarray, rho: np.ndarray, altitude: np.ndarray | None) -> np.ndarray:
    """(N,) calibrated airspeed [m/s] of true airspeed V: that of the same impact pressure at sea level. Without an
    altitude the pressure is that of the standard atmosphere with this density."""
    p0 = 101325.0
    rho0 = 1.225
    gamma = 1.4
    if altitude is None:
        altitude = _altitude_of_density(rho)
    pressure = p0 * (1.0 - 2.25577e-5 * altitude) ** 5.25588
    mach2 = V**2 * rho / (gamma * pressure)
    impact = pressure * ((1.0 + 0.5 * (gamma - 1.0) * mach2) ** (gamma / (gamma - 1.0)) - 1.0)
    ratio = (impact / p0 + 1.0) ** ((gamma - 1.0) / gamma) - 1.0
    return np.sqrt(2.0 / (gamma - 1.0) * gamma * p0 / rho0 * ratio)


def _altitude_of_density(rho: np.ndarray) -> np.ndarray:
    """Return the altitude at which the standard troposphere has a density: `standard_density` inverted."""
    grid = np.linspace(-2000.0, 20000.0, 2201)
    return np.interp(-rho, -standard_density(grid), grid)
