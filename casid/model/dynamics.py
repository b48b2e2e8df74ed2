"""The aircraft as a `Model`: six degrees of freedom, or its longitudinal or lateral reduction."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Any

import casadi as ca
import numpy as np
import scipy

from casid.arguments import names
from casid.errors import InputError, check_known
from casid.model.aircraft import Aircraft, given_aircraft
from casid.model.airframe import INERTIAS, unsymmetric_moment
from casid.model.effect import Effect
from casid.model.effect_value import EffectValue
from casid.model.in_force import InForce, named
from casid.model.measured_force import external_force, force_inputs
from casid.model.path import (
    AIR_STATES,
    GROUND,
    INPUTS,
    INTEGRALS,
    OUTPUTS,
    STATES,
    SignalPath,
    disturbance_names,
    fly,
    input_names,
)
from casid.model.rotors import acting_inputs, parameters_of, unit_of_parameter
from casid.model.station import MOVING_AIR
from casid.model.system import EquationForm, Model
from casid.model.terms import derivative_term, parse_term
from casid.model.vectors import accelerations_at, minus
from casid.model.with_effects import completed, is_masked, stations_of
from casid.records.given import given_record
from casid.records.record import Record, check_radians, filled
from casid.records.series import across_gaps, unwrapped
from casid.signals import SURFACES, scale_of, unit_of


def by_station(effects: Iterable[InForce]) -> dict[str, list]:
    """Station -> functions that change the path there, of symbolic effects."""
    found: dict[str, list] = {}
    for one in effects:
        if one.effect.change is not None and one.effect.station is not None:
            found.setdefault(one.effect.station, []).append(partial(_apply, one))
    return found


def _apply(one: InForce, path: SignalPath) -> None:
    assert one.effect.change is not None
    one.effect.change(path, one.acting(path.parameter, path.inputs))


def equation_error(
    aircraft: Aircraft,
    p: ca.SX,
    parameters: Sequence[str],
    names: tuple[str, ...],
    effects: Sequence[InForce],
    known: Sequence[str] = (),
) -> EquationForm:
    """Equation-error form: coefficients `names` computed from measured accelerations at the c.g. (paper eq. 6, 7)
    against the aerodynamic model evaluated on measured air data, rates and surfaces (eq. 8). `known` disturbances act,
    but for the wind, which the measured air data have already."""
    measured = (name for name in OUTPUTS if name not in ("phi", "theta"))
    channels = (*measured, *INPUTS, *(name for name in known if name not in MOVING_AIR))
    m = ca.SX.sym("m", len(channels))
    c = dict(zip(channels, ca.vertsplit(m), strict=True))
    path = fly(
        _measured_path(aircraft, c, dict(zip(parameters, ca.vertsplit(p), strict=True))),
        by_station(one for one in effects if one.effect.in_equations),
    )
    found = _coefficients_from_accelerations(aircraft, path, c)
    target = ca.vertcat(*[found[n] for n in names])
    prediction = ca.vertcat(*[path.coefficient[n] for n in names])
    used = [i for i, uses in enumerate(ca.which_depends(ca.vertcat(target, prediction), m, 1, False)) if uses]
    wanted = ca.SX.sym("wanted", len(used))
    full = ca.SX.zeros(len(channels))
    full[used] = wanted
    target, prediction = ca.substitute([target, prediction], [m], [full])
    return EquationForm(
        names=names, channels=tuple(channels[i] for i in used), m=wanted, target=target, prediction=prediction
    )


def _measured_path(aircraft: Aircraft, c: dict[str, ca.SX], parameter: dict[str, ca.SX]) -> SignalPath:
    """The signal path with the measured motion in the place of states."""
    velocity = [
        c["V"] * ca.cos(c["alpha"]) * ca.cos(c["beta"]),
        c["V"] * ca.sin(c["beta"]),
        c["V"] * ca.sin(c["alpha"]) * ca.cos(c["beta"]),
    ]
    level = ca.SX(0)  # forces and moments do not depend on attitude
    return SignalPath(
        aircraft=aircraft,
        inputs=c,
        parameter=parameter,
        state=dict(zip(STATES, (*velocity, c["p"], c["q"], c["r"], level, level), strict=True)),
        disturbance={d: c.get(d, ca.SX(0)) for d in disturbance_names(aircraft)},
    )


def _coefficients_from_accelerations(aircraft: Aircraft, path: SignalPath, c: dict) -> dict:
    p, q, r = rates = [c[name] for name in "pqr"]
    angular = [c[name] for name in ("pdot", "qdot", "rdot")]
    back = [-x for x in aircraft.accelerometer]
    acceleration = accelerations_at(back, [c[name] for name in ("ax", "ay", "az")], rates, angular)
    qS = path.air["qbar"] * aircraft.area
    pull, turn = external_force(c)
    ahead, aside, down = (path.mass * a for a in acceleration)
    fx, fy, fz = minus([ahead - c["thrust"], aside, down], pull)
    Ixx, Iyy, Izz, Ixz = (path.inertia[name] for name in INERTIAS)
    L = Ixx * c["pdot"] - Ixz * c["rdot"] + (Izz - Iyy) * q * r - Ixz * p * q
    M = Iyy * c["qdot"] + (Ixx - Izz) * p * r + Ixz * (p**2 - r**2) - aircraft.thrust_line_z * c["thrust"]
    N = Izz * c["rdot"] - Ixz * c["pdot"] + (Iyy - Ixx) * p * q + Ixz * q * r
    if not aircraft.inertia.symmetric:
        more = unsymmetric_moment(path.inertia, rates, angular)
        L, M, N = (moment + one for moment, one in zip((L, M, N), more, strict=True))
    L, M, N = minus((L, M, N), turn)
    sa = ca.sin(c["alpha"])
    cos_a = ca.cos(c["alpha"])
    return {
        "CL": (fx * sa - fz * cos_a) / qS,
        "CD": -(fx * cos_a + fz * sa) / qS,
        "CX": fx / qS,
        "CZ": fz / qS,
        "CY": fy / qS,
        "Cl": L / (qS * aircraft.moment_length_lateral),
        "Cm": M / (qS * aircraft.moment_length_pitch),
        "Cn": N / (qS * aircraft.moment_length_lateral),
    }


# states that move in a reduction; the others are inputs, taken from the record
MOVING = MappingProxyType({"full": STATES, "longitudinal": ("u", "w", "q", "theta"), "lateral": ("v", "p", "r", "phi")})
_FRAME_OUTPUTS = MappingProxyType(
    {
        "full": OUTPUTS,
        "longitudinal": ("V", "alpha", "q", "theta", "ax", "az", "qdot"),
        "lateral": ("beta", "p", "r", "phi", "ay", "pdot", "rdot"),
    }
)
# channels that a reduction integrates besides: states of a model that is asked for them
INTEGRATED = MappingProxyType({"full": INTEGRALS, "longitudinal": ("altitude",), "lateral": ("psi",)})
_FRAME_COEFFICIENTS = MappingProxyType({"full": "LDXZYlmn", "longitudinal": "LDXZm", "lateral": "Yln"})
_SCALE = MappingProxyType(
    {"u": 100.0, "v": 5.0, "w": 5.0, "p": 0.2, "q": 0.1, "r": 0.1, "phi": 0.3, "theta": 0.1}
    | {state: 1.0 for state, *_ in AIR_STATES.values()}
)


_STANDARD_GRAVITY = 9.80665
_SLOPE_S = 0.3


def velocity_from_air_data(V: np.ndarray, alpha: np.ndarray, beta: np.ndarray) -> np.ndarray:
    """(N, 3) body velocity u v w from airspeed and flow angles, in air at rest."""
    return np.stack([V * np.cos(alpha) * np.cos(beta), V * np.sin(beta), V * np.sin(alpha) * np.cos(beta)], axis=1)


def state_guess(
    aircraft: Aircraft, states: Sequence[str] = STATES, further: Mapping[str, str] = MappingProxyType({})
) -> Callable[[Record], np.ndarray]:
    """First guess of the trajectory (N, states + further) from measured air data, rates and attitude, else from trim,
    or from the velocity over ground with rotors. `further` states start as the channels given for them."""
    return partial(_measured_flight, dict(aircraft.trim), tuple(states), dict(further), aircraft.rotors is not None)


def _velocity_from_ground(record: Record) -> np.ndarray:
    """(N, 3) body velocity from velocity over ground and attitude; at rest where these are not measured."""
    north, east, down, phi, theta, psi = (filled(record, name, 0.0) for name in (*GROUND, "phi", "theta", "psi"))
    turn = scipy.spatial.transform.Rotation.from_euler("ZYX", np.stack([psi, theta, phi], axis=1))
    return turn.inv().apply(np.stack([north, east, down], axis=1))


def _leaning(record: Record) -> dict[str, np.ndarray]:
    """Attitude and rates that no channel has, of an aircraft that leans to where it accelerates over ground."""
    psi = filled(record, "psi", 0.0)
    velocity = {}
    for name, position in zip(GROUND[:2], ("north", "east"), strict=True):
        if name in record or position in record:
            velocity[name] = filled(record, name, 0.0) if name in record else _slope(record, record[position])
    if len(velocity) < 2:
        return {}
    north, east = (_slope(record, series) for series in velocity.values())
    ahead = np.cos(psi) * north + np.sin(psi) * east
    aside = np.cos(psi) * east - np.sin(psi) * north
    found = {}
    for angle, rate, leans in (("phi", "p", aside), ("theta", "q", -ahead)):
        values = filled(record, angle, 0.0) if angle in record else np.arctan2(leans, _STANDARD_GRAVITY)
        found |= {} if angle in record else {angle: values}
        found |= {} if rate in record else {rate: _slope(record, values)}
    return found


def _slope(record: Record, series: np.ndarray) -> np.ndarray:
    """(N,) slope of a series by parabolas over a part of a second."""
    whole = across_gaps(record.t, series)
    window = min(2 * max(round(_SLOPE_S / (2.0 * record.dt)), 1) + 1, (len(record) - 1) // 2 * 2 + 1)
    if window < 3:
        return np.gradient(whole, record.t)
    return np.asarray(scipy.signal.savgol_filter(whole, window, 2, deriv=1, delta=record.dt, mode="interp"))


def _measured_flight(
    trim: Mapping[str, float], states: Sequence[str], further: Mapping[str, str], hovers: bool, record: Record
) -> np.ndarray:
    alpha = filled(record, "alpha", trim.get("alpha", 0.0))
    velocity = velocity_from_air_data(filled(record, "V", trim.get("V", np.nan)), alpha, filled(record, "beta", 0.0))
    if hovers and "V" not in record:
        velocity = _velocity_from_ground(record)
    if not np.isfinite(velocity).all():
        raise InputError(f"record '{record.name}': airspeed V is neither a channel nor in [trim]; give one of them")
    table = dict(zip("uvw", velocity.T, strict=True))
    for name in ("p", "q", "r", "phi"):
        table[name] = filled(record, name, 0.0)
    table["theta"] = filled(record, "theta", trim.get("theta", float(alpha[0])))
    if hovers:
        table |= _leaning(record)
    table |= {s: filled(record, channel, trim.get(channel, 0.0)) for s, channel in further.items()}
    return np.stack([table[name] for name in (*states, *further)], axis=1)


def aircraft_model(
    aircraft: Aircraft | str | Path,
    *,
    axes: str = "full",
    outputs: Iterable[str] | None = None,
    effects: Iterable[EffectValue | Effect] | None = None,
    known: Iterable[str] = (),
    turning: Mapping[str, float] = MappingProxyType({}),
    equations: bool = True,
) -> Model:
    """The aircraft of an aircraft file, or of the file of that name, as a symbolic model.

    Its parameters are the derivatives and terms of the file, the values of its free tables, `bias_<output>` (nominal 0)
    and one per size of each effect: `actuator_lag(delta_e)`, further ones `structural_mode(q).frequency_hz`, the time
    at which one sets in `gust(z).onset[m1]`. States of effects stand behind those of the aircraft.

    Parameters
    ----------
    aircraft
        The aircraft, or the name of its file.
    axes
        "full", or "longitudinal" (u w q theta move) or "lateral" (v p r phi move); the states that do not move are then
        inputs with the names of `STATES`, see `flight_inputs`.
    outputs
        Channels that are modelled; default all that the axes move. "psi", "altitude", "north" and "east" become states
        too, and the heading also for "v_north", "v_east" and "v_down".
    effects
        The effects in force, in the place of those of the aircraft file.
    known
        Disturbances that become inputs, because their time history is given; the external force of records with one.
    turning
        Axis, q or r -> sign of the air's rotation about it by the gradient of its velocity (`air_rotation`). By the
        sense of the axes it is -1 and 1; some simulators have them otherwise. These are further states, behind all
        others.
    equations
        Whether it has the equation-error form, which takes half of the time to build.

    Returns
    -------
    Model
        Its states are among u v w [m/s], p q r [rad/s], phi theta [rad], its inputs the surfaces [rad], thrust [N] and
        density rho [kg/m3] of a wing, the rotors by name and the battery where it matters, further ones by `axes` and
        `known`; `flight_inputs` makes records that have all of them.

    Raises
    ------
    InputError
        For unknown axes or outputs.

    Examples
    --------
    >>> import casid as cs
    >>> model = cs.aircraft_model("casid/cli/demo/aircraft.toml", axes="longitudinal", outputs=["alpha", "q"])
    >>> model.states, model.outputs
    (('u', 'w', 'q', 'theta'), ('alpha', 'q'))
    """
    aircraft = given_aircraft(aircraft, "aircraft_model")
    _check_axes(aircraft, axes)
    chosen = names(outputs, "aircraft_model: outputs") if outputs is not None else None
    scope = {"axes": axes, "outputs": chosen, "known": tuple(known), "turning": dict(turning), "equations": equations}
    found = _named(aircraft, aircraft.effects if effects is None else tuple(effects))
    chosen = _outputs(aircraft, axes, chosen, found)
    probe = _probe(aircraft, axes, chosen) if any(one.effect.change is None for one in found) else None
    stations = () if probe is None else stations_of(found, probe, chosen)
    acting = [name for name in stations if name in disturbance_names(aircraft)]
    masks = [one.masked for one in found if one.masked and is_masked(one.effect)]
    given = tuple(dict.fromkeys((*scope["known"], *acting, *masks)))
    by_equations = equations and not aircraft.rotors
    moving = MOVING[axes]
    moved = moved_coefficients(aircraft, axes)
    own = _own_parameters(aircraft)
    symbolic = [one for one in found if one.effect.change is not None]
    turning = {axis: sign for axis, sign in turning.items() if axis in moving}
    further = _further_states(chosen, symbolic, turning)
    own |= {f"bias_{o}": (0.0, 0.0, unit_of(o)) for o in _read(aircraft, {*further, *chosen})}
    nominal = {name: value for name, (value, _, _) in own.items()}
    nominal |= {name: value for one in symbolic for name, value in one.parameters.items()}
    disturbances = tuple(d for d in disturbance_names(aircraft) if d not in given)
    inputs = (*input_names(aircraft), *(s for s in STATES if s not in moving), *given)
    x, u, p, w = (
        ca.SX.sym(letter, len(names))
        for letter, names in (("x", (*moving, *further)), ("u", inputs), ("p", nominal), ("w", disturbances))
    )
    named_states = dict(zip((*moving, *further), ca.vertsplit(x), strict=True))
    named_inputs = dict(zip(inputs, ca.vertsplit(u), strict=True))
    path = fly(
        SignalPath(
            aircraft=aircraft,
            state={s: named_inputs[s] for s in STATES if s not in moving} | named_states,
            inputs=named_inputs,
            parameter=dict(zip(nominal, ca.vertsplit(p), strict=True)),
            disturbance=dict(zip(disturbances, ca.vertsplit(w), strict=True)) | {d: named_inputs[d] for d in given},
            turning=turning,
        ),
        by_station(symbolic),
    )
    stds = {name: std for name, (_, std, _) in own.items() if std > 0.0}
    units = {name: unit for name, (_, _, unit) in own.items()}
    bare = Model(
        name=aircraft.name,
        states=tuple(named_states),
        inputs=inputs,
        parameters=tuple(nominal),
        outputs=chosen,
        disturbances=disturbances,
        x=x,
        u=u,
        p=p,
        w=w,
        f=ca.vertcat(*[path.derivative[s] for s in named_states]),
        h=ca.vertcat(*[path.output[o] for o in chosen]),
        nominal=nominal,
        state_scale={s: typical_size(further.get(s, s)) for s in named_states},
        guess=state_guess(aircraft, moving, further),
        prior_std=stds | {name: std for one in symbolic for name, std in one.prior_std.items()},
        equation=equation_error(aircraft, p, tuple(nominal), moved, symbolic, given) if by_equations else None,
        units=units | {name: unit for one in symbolic for name, unit in one.units.items()},
        prepare=partial(flight_inputs, aircraft, axes=axes),
        extend=partial(_extended, aircraft, tuple(found), scope),
    )
    return replace(bare, effects=tuple(found)) if probe is None else completed(bare, found, probe)


def _named(aircraft: Aircraft, effects: Sequence[EffectValue | Effect]) -> list[InForce]:
    """Effects with the names of their parameters; an effect without a size is one that is symbolic, or none."""
    own = named((one for one in effects if isinstance(one, EffectValue)), f"aircraft '{aircraft.name}'")
    for one in own:
        if one.effect.change is not None and one.effect.station is None:
            raise InputError(f"aircraft '{aircraft.name}': effect {one.name} is of a model of your own equations")
    others = [
        InForce(effect=one, name=one.name) for one in effects if isinstance(one, Effect) and one.change is not None
    ]
    return [*own, *others]


def _extended(
    aircraft: Aircraft, found: Sequence[InForce], scope: Mapping[str, Any], further: Sequence[EffectValue]
) -> Model:
    """The model of the same scope with further effects."""
    return aircraft_model(aircraft, effects=[*(one.value or one.effect for one in found), *further], **scope)


def _probe(aircraft: Aircraft, axes: str, outputs: Sequence[str]) -> Record:
    """A record of rest that has every channel from which effects are made."""
    t = 0.01 * np.arange(8)
    rest = dict.fromkeys((*INPUTS, *STATES, *outputs, *OUTPUTS, *INTEGRALS), np.zeros(8))
    if aircraft.rotors is not None:
        rest |= dict.fromkeys(aircraft.rotors.inputs, np.ones(8))
    return flight_inputs(aircraft, Record(name="probe", t=t, channels=rest), axes)


def _check_axes(aircraft: Aircraft, axes: str) -> None:
    check_known("axes", (axes,), MOVING, "aircraft_model")
    if aircraft.rotors is not None and axes != "full":
        raise InputError(f"aircraft_model: axes is '{axes}'; the rotors of '{aircraft.name}' move all: write 'full'")


def _read(aircraft: Aircraft, asked: Iterable[str]) -> tuple[str, ...]:
    """The channels whose instruments have an offset in a model: those of the axes, and further ones that are asked."""
    own = outputs_of(aircraft) if aircraft.rotors else OUTPUTS
    return (*own, *(name for name in (*INTEGRALS, *GROUND) if name in asked))


def _own_parameters(aircraft: Aircraft) -> dict[str, tuple[float, float, str]]:
    """Value, a-priori 1-sigma (0: none) and unit of the derivatives and terms of the file, of the values of its free
    tables, and of numbers of its rotors."""
    rows = {name: (value, derivative_term(name)[1].unit) for name, value in aircraft.derivatives.items()}
    rows |= {f"{c}_{term}": (v, parse_term(term).unit) for c, row in aircraft.terms.items() for term, v in row.items()}
    rows |= {name: (value, one.unit) for one in aircraft.tables if one.free for name, value in one.knots.items()}
    found = {name: (value, aircraft.relative_uncertainty * abs(value), unit) for name, (value, unit) in rows.items()}
    of_rotors = parameters_of(aircraft.rotors) if aircraft.rotors else {}
    return found | {name: (value, std, unit_of_parameter(name)) for name, (value, std) in of_rotors.items()}


def _outputs(
    aircraft: Aircraft, axes: str, outputs: Sequence[str] | None, effects: Sequence[InForce]
) -> tuple[str, ...]:
    """The channels that are asked for, by default those of the axes and of instruments at fault; raises InputError for
    one that these axes do not have."""
    own = outputs_of(aircraft, axes)
    read = {channel for one in effects if one.value is not None for channel in one.effect.reads}
    chosen = outputs if outputs is not None else (*own, *(name for name in INTEGRATED[axes] if name in read))
    valid = (*own, *INTEGRATED[axes], *(GROUND if axes == "full" else ()))
    check_known("output", chosen, valid, f"{axes} model of '{aircraft.name}'")
    return tuple(chosen)


def outputs_of(aircraft: Aircraft, axes: str = "full") -> tuple[str, ...]:
    """The channels that these axes of an aircraft move; without a wing none of the air data."""
    return tuple(name for name in _FRAME_OUTPUTS[axes] if aircraft.winged or name not in ("V", "alpha", "beta"))


def _further_states(outputs: Iterable[str], effects: Sequence[InForce], turning: Iterable[str]) -> dict[str, str]:
    """State besides those that the axes move -> the channel that it is as large as."""
    asked = {*outputs, *(channel for one in effects for channel in one.effect.reads)}
    if asked & {*GROUND, "north", "east"}:
        asked.add("psi")
    further = {s: s for s in INTEGRALS if s in asked} | {s: c for one in effects for s, c in one.effect.states.items()}
    return further | {AIR_STATES[axis][0]: AIR_STATES[axis][0] for axis in turning}


def moved_coefficients(aircraft: Aircraft, axes: str) -> tuple[str, ...]:
    """The aerodynamic coefficients that act on the states which `axes` move."""
    if not aircraft.winged:
        return ()
    return tuple(c for c in aircraft.coefficients if c[1] in _FRAME_COEFFICIENTS[axes])


def has_aerodynamics(aircraft: Aircraft, axis: str) -> bool:
    """Return True if the file gives a coefficient that acts on an axis; a function of the user counts as giving all."""
    given = {derivative_term(name)[0] for name in aircraft.derivatives} | set(aircraft.terms)
    given |= {table.coefficient for table in aircraft.tables}
    return aircraft.aerodynamics is not None or not given.isdisjoint(moved_coefficients(aircraft, axis))


def standard_density(altitude: np.ndarray) -> np.ndarray:
    """Density [kg/m3] of the standard atmosphere (ISO 2533) at geometric altitude [m], up to 20 km."""
    below = 1.225 * (1.0 - 2.25577e-5 * np.minimum(altitude, 11000.0)) ** 4.25588
    return below * np.exp((11000.0 - np.maximum(altitude, 11000.0)) / 6341.6)


def flight_inputs(aircraft: Aircraft | str | Path, record: Record | str | Path, axes: str = "full") -> Record:
    """The record with every input channel that an aircraft model wants.

    Density comes from the record, from altitude (standard atmosphere) or from [trim]; thrust from the record or from
    [trim], constant; the states that a reduction does not move from the measured channels. `record.notes` lists what
    was filled in. Heading and bank go on where they pass 180 or 360 deg.

    Parameters
    ----------
    aircraft
        The aircraft, or the name of its file.
    record
        The flight record, or the name of its file.
    axes
        As in `aircraft_model`.

    Returns
    -------
    Record
        A copy with the inputs of `aircraft_model(aircraft, axes=axes)` added.

    Raises
    ------
    InputError
        For unknown axes, degrees in a radian channel, and an input that neither the record nor [trim] gives.

    Examples
    --------
    >>> import casid as cs
    >>> demo = "casid/cli/demo/"
    >>> record = cs.flight_inputs(demo + "aircraft.toml", demo + "m1.csv", axes="longitudinal")
    >>> all(name in record for name in ("delta_e", "thrust", "rho", "v", "p", "r", "phi"))
    True
    """
    aircraft = given_aircraft(aircraft, "flight_inputs")
    record = given_record(record, "flight_inputs")
    check_known("axes", (axes,), MOVING, "flight_inputs")
    check_radians(record)
    rotors = aircraft.rotors.inputs if aircraft.rotors else ()
    pull = force_inputs([record])
    _check_complete(record, (*SURFACES, "thrust", "rho", *rotors, *pull))
    notes = list[str]()
    n = len(record)
    acting = acting_inputs(aircraft.rotors, aircraft.mass, record) if aircraft.rotors else {}
    added = acting | {name: np.zeros(n) for name in pull if name not in record}
    if not aircraft.winged:
        added |= {name: unwrapped(record[name]) for name in ("psi", "phi") if name in record}
        return record.with_channels(**added)
    for surface in SURFACES:
        if surface not in record:
            if axes != "full" and (surface == "delta_e") == (axes == "lateral"):
                added[surface] = np.full(n, aircraft.trim.get(surface, 0.0))
                continue
            raise InputError(f"record '{record.name}': input channel '{surface}' is missing; the {axes} model needs it")
    if "rho" not in record:
        if "altitude" in record:
            added["rho"] = standard_density(filled(record, "altitude", 0.0))
            notes.append("rho from altitude, standard atmosphere")
        elif "rho" in aircraft.trim or "altitude" in aircraft.trim:
            rho = aircraft.trim.get("rho") or float(standard_density(np.array(aircraft.trim["altitude"])))
            added["rho"] = np.full(n, rho)
            notes.append("rho constant, from [trim]")
        else:
            raise InputError(
                f"record '{record.name}': density rho cannot be had: give a channel rho or altitude, or rho in [trim]"
            )
    if "thrust" not in record:
        if "thrust" not in aircraft.trim:
            raise InputError(
                f"record '{record.name}': thrust cannot be had: give a channel thrust, or thrust in [trim]"
            )
        added["thrust"] = np.full(n, aircraft.trim["thrust"])
        notes.append("thrust constant, from [trim]")
    fixed = [s for s in STATES if s not in MOVING[axes]]
    if fixed:
        columns = state_guess(aircraft, fixed)(record)
        added |= dict(zip(fixed, columns.T, strict=True))
        added |= _without_turning(aircraft, record, added) | _air_data_of_frozen_plane(aircraft, record, axes)
    added |= {name: unwrapped(added.get(name, record[name])) for name in ("psi", "phi") if name in record}
    return record.with_channels(**added).with_notes(*notes)


def _without_turning(aircraft: Aircraft, record: Record, seen: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Velocities of the c.g. from those that vanes have `seen`, without what rotation adds at the place of a vane."""
    p, q, r = (filled(record, name, 0.0) for name in "pqr")
    (x, y, _), (ahead, _, below) = aircraft.alpha_vane, aircraft.beta_vane
    turning = {"v": ("beta", r * ahead - p * below), "w": ("alpha", p * y - q * x)}
    return {name: seen[name] - more for name, (of, more) in turning.items() if name in seen and of in record}


def _check_complete(record: Record, inputs: Sequence[str]) -> None:
    """Inputs have no gaps: their course there is unknown."""
    for name in inputs:
        if name in record and len(gaps := np.flatnonzero(np.isnan(record[name]))):
            raise InputError(
                f"record '{record.name}', t = {record.t[gaps[0]]:.6g} s: the sample of input {name} is missing (nan), "
                f"{len(gaps)} in all; an input must be complete: fill the gaps, or cut the record there"
            )


def _air_data_of_frozen_plane(aircraft: Aircraft, record: Record, axes: str) -> dict[str, np.ndarray]:
    """Air data that a reduction does not model and the record does not have, as its frozen states have them."""
    u, v, w = state_guess(aircraft, ("u", "v", "w"))(record).T
    V = np.sqrt(u**2 + v**2 + w**2)
    filled = {"beta": np.arctan2(v, np.hypot(u, w))} if axes == "longitudinal" else {"V": V, "alpha": np.arctan2(w, u)}
    return {name: values for name, values in filled.items() if name not in record}


def typical_size(name: str) -> float:
    """Typical size of a state or channel, for conditioning."""
    return _SCALE.get(name, scale_of(name))
