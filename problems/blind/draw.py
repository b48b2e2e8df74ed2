"""Draw a hidden effect of a kind: its target, a size that a flight-test engineer would notice, onsets and records."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType

import numpy as np

from casid.errors import InputError
from casid.model import operators
from casid.model.terms import parse_term
from casid.model.vocabulary import KINDS
from casid.records.record import Record
from casid.signals import SURFACES
from problems.blind.case import NOT_DRAWN, RECORDS, Hidden, family
from problems.blind.scene import LATERAL, Scene, even_products

Rng = np.random.Generator
_DEG = np.pi / 180.0
_FITTED = RECORDS[:-1]
_TRIES = 60
_NEEDS_DEVICE = ("configuration_change",)  # a flap, gear or speedbrake, which not every aircraft file of JSBSim has
_LEAST_SHARE = 0.06  # of a coefficient's variation that a drawn aerodynamic term must add visibly
_FELT = 0.05  # of a surface's motion that a rate limit must take
_TURNED = 0.06 * _DEG  # r.m.s. of the flow angle that a vane away from the c.g. must read besides
_AT_WORK = 0.02  # part of the flight in which it must act: two surfaces that meet for an instant are no effect
# channel -> smallest and largest bias
_BIAS: Mapping[str, tuple[float, float]] = MappingProxyType(
    {
        "p": (0.2 * _DEG, 0.6 * _DEG),
        "q": (0.2 * _DEG, 0.6 * _DEG),
        "r": (0.2 * _DEG, 0.6 * _DEG),
        "alpha": (0.6 * _DEG, 1.5 * _DEG),
        "beta": (0.6 * _DEG, 1.5 * _DEG),
        "phi": (0.6 * _DEG, 1.5 * _DEG),
        "theta": (0.6 * _DEG, 1.5 * _DEG),
        "ax": (0.1, 0.3),
        "ay": (0.1, 0.3),
        "az": (0.15, 0.4),
        "V": (2.0, 5.0),
    }
)
_SCALED = ("alpha", "beta", "p", "q", "r", "phi", "theta", "ay", "az")
_LATE = ("inertial", "alpha", "beta", "p", "q", "r", "phi", "theta", "ay", "az")
_DRIVES = {"q": "delta_e", "az": "delta_e", "p": "delta_a", "r": "delta_r", "ay": "delta_r"}


def draw_effect(rng: Rng, kind: str, scene: Scene) -> Hidden:
    """One effect of a kind of the vocabulary, for this flight."""
    if kind in ("actuator_lag", "input_delay", "rate_limit", "dead_zone", "backlash"):
        return _servo(rng, kind, scene)
    if kind.startswith("sensor_"):
        return _sensor(rng, kind)
    return _DRAWS[kind](rng, scene)


def draw_two(rng: Rng, scene: Scene) -> tuple[Hidden, Hidden]:
    """Two effects of different families at once, of kinds that each can be seen alone."""
    hard = ("mass", "inertia", "turbulence", *(() if scene.free_steps or scene.configuration else _NEEDS_DEVICE))
    kinds = [k for k in KINDS if k not in hard and k not in NOT_DRAWN]
    while True:
        first, second = (draw_effect(rng, str(k), scene) for k in rng.choice(kinds, 2, replace=False))
        apart = family(first.kind, first.target) != family(second.kind, second.target)
        if apart and not (first.imitated or second.imitated):
            return first, second


def _sign(rng: Rng) -> float:
    return float(rng.choice((-1.0, 1.0)))


def _digits(value: float | np.floating) -> float:
    return float(f"{value:.4g}")


def _some(rng: Rng, part: float) -> tuple[str, ...]:
    """All records, or with probability `part` one or two of those that are fitted, and by chance the last."""
    if rng.random() >= part:
        return RECORDS
    chosen = {str(r) for r in rng.choice(_FITTED, rng.integers(1, 3), replace=False)}
    if rng.random() < 0.4:
        chosen.add(RECORDS[-1])
    return tuple(r for r in RECORDS if r in chosen)


def _events(rng: Rng, scene: Scene, moved: str | None = None, length: float = 0.0) -> dict[str, float]:
    """Record -> onset, in one to three records. With `moved`, that input moves on both sides of the onset."""
    chosen = sorted(str(r) for r in rng.choice(_FITTED, rng.integers(1, 4), replace=False))
    if rng.random() < 0.4:
        chosen.append(RECORDS[-1])
    onsets = {}
    for name in chosen:
        record = scene.record(name)
        for _ in range(200):
            onset = round(float(rng.uniform(0.2, 0.75)) * (record.duration - length), 2)
            if moved is None or _moves_around(record, moved, onset):
                onsets[name] = onset
                break
    if moved is not None and onsets.keys().isdisjoint(_FITTED):  # there it moves early, late or not at all
        name, onset = _amid_motion([scene.record(fitted) for fitted in _FITTED], moved)
        onsets[name] = onset
    return onsets


def _amid_motion(records: Sequence[Record], moved: str) -> tuple[str, float]:
    """Of the records in which an input moves notably the one in which it does so nearest to the middle, and when."""
    activity = {record.name: _activity(record, moved) for record in records}
    notable = 0.3 * max(a[-1] for a in activity.values())
    moving = [record for record in records if activity[record.name][-1] >= notable]
    amid = {r.name: float(r.t[np.searchsorted(activity[r.name], 0.4 * activity[r.name][-1])]) for r in moving}
    name = min(moving, key=lambda record: abs(amid[record.name] - 0.5 * record.duration)).name
    return name, round(amid[name], 2)


def _moves_around(record: Record, name: str, onset: float) -> bool:
    activity = _activity(record, name)
    before = activity[np.searchsorted(record.t, onset)] / max(activity[-1], 1e-30)
    return 0.2 <= before <= 0.7


def _activity(record: Record, name: str) -> np.ndarray:
    """(N,) how much of its motion an input has behind it."""
    return np.cumsum((record[name] - np.median(record[name])) ** 2)


# -- controls ----------------------------------------------------------------------------------------------------------


def _servo(rng: Rng, kind: str, scene: Scene) -> Hidden:
    surface = str(rng.choice(SURFACES))
    size = scene.sizes[surface]
    value = {
        "actuator_lag": lambda: rng.uniform(0.08, 0.30),
        "input_delay": lambda: round(rng.uniform(0.06, 0.20) / 0.005) * 0.005,  # whole frames of JSBSim
        "rate_limit": lambda: size * rng.uniform(1.8, 3.5),
        "dead_zone": lambda: size * rng.uniform(0.15, 0.30),
        "backlash": lambda: size * rng.uniform(0.15, 0.30),
    }[kind]()
    while kind == "rate_limit" and _lost_to_a_limit(scene, surface, value) < _FELT:
        value *= 0.8  # the surface is never as fast as the limit
    return Hidden(kind=kind, target=surface, value=_digits(value))


def _lost_to_a_limit(scene: Scene, surface: str, rate: float) -> float:
    """r.m.s. of what a rate limit takes from a surface's motion in the fitted records, as a part of it."""
    fitted = [r for r in scene.records if r.name in _FITTED]
    moved = [r[surface] for r in fitted]
    lost = [y - operators.rate_limit(r.t, y, rate) for r, y in zip(fitted, moved, strict=True)]
    return float(np.std(np.concatenate(lost)) / np.std(np.concatenate(moved)))


def _effectiveness(rng: Rng, scene: Scene) -> Hidden:
    # JSBSim's records have the thrust that is really there, so none can be missing
    target = str(rng.choice((*SURFACES, "thrust") if scene.free_steps else SURFACES))
    onsets = _events(rng, scene, None if target == "thrust" else target)
    return Hidden(
        kind="effectiveness_change",
        target=target,
        value=-_digits(rng.uniform(0.15, 0.50)),
        records=tuple(onsets),
        onset_s=onsets,
    )


# -- instruments -------------------------------------------------------------------------------------------------------


def _sensor(rng: Rng, kind: str) -> Hidden:
    records = _some(rng, 0.2)
    if kind == "sensor_bias":
        heavy = np.array([3.0 if name in "pqr" else 1.0 for name in _BIAS])
        target = str(rng.choice(list(_BIAS), p=heavy / heavy.sum()))
        value = _sign(rng) * rng.uniform(*_BIAS[target])
    elif kind == "sensor_scale":
        target, value = str(rng.choice(_SCALED)), _sign(rng) * rng.uniform(0.05, 0.15)
    elif kind == "sensor_delay":
        target, value = str(rng.choice(_LATE)), rng.uniform(0.06, 0.20)
    else:
        target, value = str(rng.choice(_LATE)), rng.uniform(0.08, 0.25)
    return Hidden(kind=kind, target=target, value=_digits(value), records=records)


def _vane(rng: Rng, scene: Scene) -> Hidden:
    arm = float(np.clip(rng.uniform(0.25, 0.6) * scene.span / 2.0, 1.2, 8.0))
    angle = str(rng.choice(("alpha", "beta")))
    moved = np.concatenate([r["q" if angle == "alpha" else "r"] / r["V"] for r in scene.records])
    return Hidden(kind="vane_position", target=angle, value=_digits(max(arm, _TURNED / float(np.std(moved)))))


def _accelerometer(rng: Rng, scene: Scene) -> Hidden:
    axis = str(rng.choice(("x", "y", "z"), p=(0.6, 0.2, 0.2)))
    arm = float(np.clip(rng.uniform(0.08, 0.2) * scene.span / 2.0, 0.5, 3.0))
    return Hidden(kind="accelerometer_position", target=axis, value=_sign(rng) * _digits(arm))


def _mode(rng: Rng, scene: Scene) -> Hidden:
    channel = str(rng.choice(list(_DRIVES)))
    frequency = _digits(rng.uniform(2.0, 6.0))
    damping = _digits(rng.uniform(0.015, 0.05))
    parts = [operators.mode(r.t, r[_DRIVES[channel]], frequency, damping)[0] for r in scene.records]
    measured = np.concatenate([r[channel] for r in scene.records])
    value = rng.uniform(0.10, 0.30) * np.std(measured) / np.std(np.concatenate(parts))
    parameters = {"frequency_hz": frequency, "damping": damping}
    return Hidden(kind="structural_mode", target=channel, value=_digits(value), parameters=parameters)


# -- aerodynamics ------------------------------------------------------------------------------------------------------


def _aero_term(rng: Rng, scene: Scene) -> Hidden:
    """A product that symmetry allows, or the effect of Mach on drag or pitching moment."""
    for _ in range(_TRIES):
        coefficient = str(rng.choice(list(scene.structure)))
        degree = 2 if rng.random() < 0.7 else 3
        terms = [t for t in even_products(coefficient, (degree,)) if len(parse_term(t).factors) <= 2]
        if coefficient in ("CD", "Cm") and rng.random() < 0.1:
            terms = ["mach"]
        term = str(rng.choice(terms))
        if term in scene.structure[coefficient]:
            continue
        value, share = scene.size_of_share(coefficient, scene.column(term), rng.uniform(0.08, 0.30))
        if share >= _LEAST_SHARE and scene.at_work(coefficient, scene.column(term)) >= _AT_WORK:
            return Hidden(
                kind="aero_term",
                target=coefficient,
                term=term,
                value=_sign(rng) * _digits(value),
                parameters={"share": _digits(share)},
            )
    raise InputError("no aerodynamic term can be seen in this flight; draw another")


def _unsteady(rng: Rng, scene: Scene) -> Hidden:
    """Of some draws of a physical size, the one that the derivatives can imitate least: in level flight alphadot is
    nearly a sum of alpha, q and delta_e. Larger, where none of them can be seen."""
    drawn = []
    for _ in range(5):
        coefficient = str(rng.choice(("CL", "Cm", "Cm", "CY", "Cl", "Cn")))
        rate, most = ("betadot", 1.5) if coefficient in LATERAL else ("alphadot", 16.0)
        wanted, share = scene.size_of_share(coefficient, scene.column(rate), rng.uniform(0.08, 0.20))
        value = min(wanted, most * rng.uniform(0.5, 1.0))
        sign = 1.0 if coefficient == "CL" else -1.0 if coefficient == "Cm" else _sign(rng)
        drawn.append((share * value / wanted, coefficient, sign * value))
    share, coefficient, value = max(drawn)
    seen = max(share, _LEAST_SHARE)
    return Hidden(
        kind="unsteady_aero",
        target=coefficient,
        value=_digits(value * seen / share),
        parameters={"share": _digits(seen)},
    )


def _configuration(rng: Rng, scene: Scene) -> Hidden:
    onsets = _events(rng, scene)
    if scene.free_steps:
        steps = {"CL": _sign(rng) * rng.uniform(0.05, 0.20), "CD": rng.uniform(0.008, 0.03)}
        if rng.random() < 0.5:
            steps["Cm"] = _sign(rng) * rng.uniform(0.01, 0.03)
        duration = float(rng.uniform(0.3, 2.0))
    else:
        factor = rng.uniform(0.7, 1.3)
        steps, duration = {name: factor * step for name, step in scene.configuration.items()}, 1.0
    first, *others = steps
    return Hidden(
        kind="configuration_change",
        target="+".join(steps),
        value=_digits(steps[first]),
        records=tuple(onsets),
        onset_s=onsets,
        parameters={n: _digits(steps[n]) for n in others} | {"duration": _digits(duration)},
    )


# -- mass and propulsion -----------------------------------------------------------------------------------------------


def _cg(rng: Rng, scene: Scene) -> Hidden:
    axis = str(rng.choice(("x", "y", "z"), p=(0.7, 0.15, 0.15)))
    value = _sign(rng) * rng.uniform(0.03, 0.08) * scene.chord
    return Hidden(kind="cg_offset", target=axis, value=_digits(value), records=_some(rng, 0.6))


def _mass(rng: Rng, scene: Scene) -> Hidden:
    value = rng.uniform(0.05, 0.10) * scene.aircraft.mass
    return Hidden(kind="mass", value=_digits(value), records=_some(rng, 0.6))


def _inertia(rng: Rng, scene: Scene) -> Hidden:
    component = str(rng.choice(("Ixx", "Iyy", "Izz", "Ixz")))
    whole = getattr(scene.aircraft.inertia, "Ixx" if component == "Ixz" else component)
    value = _sign(rng) * rng.uniform(0.10, 0.25) * whole
    return Hidden(kind="inertia", target=component, value=_digits(value), records=_some(rng, 0.6))


def _asymmetry(rng: Rng, scene: Scene) -> Hidden:
    value = _sign(rng) * rng.uniform(0.04, 0.10) * scene.span / 2.0
    return Hidden(kind="thrust_asymmetry", value=_digits(value))


def _thrust_line(rng: Rng, scene: Scene) -> Hidden:
    return Hidden(kind="thrust_line", value=_sign(rng) * _digits(rng.uniform(0.15, 0.40) * scene.chord))


# -- moving air --------------------------------------------------------------------------------------------------------


def _shear(rng: Rng, scene: Scene) -> Hidden:
    onsets = _events(rng, scene, length=5.0)
    value = _sign(rng) * _digits(rng.uniform(0.2, 0.5))
    axis = str(rng.choice(("x", "y", "z")))
    parameters = {"duration": _digits(rng.uniform(5.0, 12.0))} if rng.random() < 0.5 else {}
    return Hidden(
        kind="wind_shear", target=axis, value=value, records=tuple(onsets), onset_s=onsets, parameters=parameters
    )


def _gust(rng: Rng, scene: Scene) -> Hidden:
    length = _digits(rng.uniform(1.0, 3.0))
    onsets = _events(rng, scene, length=length + 1.0)
    speed = _sign(rng) * _digits(float(np.clip(rng.uniform(0.025, 0.055) * scene.V, 2.5, 10.0)))
    axis = str(rng.choice(("x", "y", "z"), p=(0.2, 0.4, 0.4)))
    return Hidden(
        kind="gust", target=axis, value=speed, records=tuple(onsets), onset_s=onsets, parameters={"length": length}
    )


def _turbulence(rng: Rng, scene: Scene) -> Hidden:
    return Hidden(kind="turbulence", value=_digits(rng.uniform(0.5, 2.0)))


_DRAWS: Mapping[str, Callable[[Rng, Scene], Hidden]] = MappingProxyType(
    {
        "effectiveness_change": _effectiveness,
        "vane_position": _vane,
        "accelerometer_position": _accelerometer,
        "structural_mode": _mode,
        "aero_term": _aero_term,
        "unsteady_aero": _unsteady,
        "configuration_change": _configuration,
        "cg_offset": _cg,
        "mass": _mass,
        "inertia": _inertia,
        "thrust_asymmetry": _asymmetry,
        "thrust_line": _thrust_line,
        "wind_shear": _shear,
        "gust": _gust,
        "turbulence": _turbulence,
    }
)
