"""Blind tests: hide an effect, drawn from a seed, in flight records, and seal the answer.

    python -c "from problems.blind import hide; hide('jsbsim', 'actuator_lag', 3, 'sets', 'answers')"

writes sets/<name>/m1.csv .. m4.csv and aircraft.toml, which know nothing of it, and answers/<name>.json. The name says
nothing either. Sets of "do328" and "f16" are flown by casid with its own effects, the F-16 on its tables and in closed
loop; sets of "jsbsim" by JSBSim, with the effect made there. All also come as instruments as they are record them
(`instruments`): "do328_instruments" and so on. Sets of "independent" are flown, with the effect, by a simulator that
shares no code with casid, sets of "strips" by aircraft of lifting strips, sets of "rotors" by RotorPy. Seeds below
REPORTING_FROM are for development, the others for reported results; in "jsbsim" the two do not even share an aircraft.
"""

from __future__ import annotations

import hashlib
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from importlib.util import find_spec
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from casid.errors import InputError, unknown
from casid.model.aircraft import Aircraft
from casid.model.vocabulary import KINDS
from casid.records.readers import write_record
from casid.records.record import Record
from casid.signals import SURFACES
from problems.blind import do328, f16, independent, rotors, strips
from problems.blind import jsbsim as blind_jsbsim
from problems.blind.case import NOT_DRAWN, OUTSIDE, RECORDS, Answer, Hidden
from problems.blind.draw import draw_effect, draw_two
from problems.blind.flown import Flown
from problems.blind.instruments import Instruments
from problems.blind.manoeuvres import Segment, draw_segments, histories
from problems.blind.outside import SIGNALS, Outside, along, drift
from problems.blind.scene import Scene, demanded
from problems.jsbsim.airframe import RATE_HZ, Airframe
from problems.jsbsim.apriori import Regression, geometry, guessed
from problems.jsbsim.corpus import rounded
from problems.jsbsim.fleet import DEVELOPMENT, REPORTING, fleet_airframe
from problems.jsbsim.flight import NOISE

REPORTING_FROM = 1000
WITH_INSTRUMENTS = "_instruments"
_FLOWN = MappingProxyType({"do328": do328.plane, "f16": f16.plane})  # by casid
_AIRCRAFT = ("do328", "jsbsim", "f16")
SETS = (*_AIRCRAFT, *(name + WITH_INSTRUMENTS for name in _AIRCRAFT), independent.NAME, strips.NAME, rotors.NAME)
_ONE_SIZE = MappingProxyType({strips.NAME: strips.flight, rotors.NAME: rotors.flight})
CASES: tuple[str, ...] = (
    *(f"clean-{i}" for i in range(1, 11)),
    *(kind for kind in KINDS if kind not in NOT_DRAWN),
    *(f"two-{i}" for i in range(1, 6)),
    *(kind for kind in OUTSIDE if kind not in NOT_DRAWN),
)
_OFF = (0.1, 0.3)  # by which the a-priori derivatives miss the truth
_RATES_HZ, _RATE_ODDS = (20.0, 25.0, 40.0, 50.0, 100.0), (0.1, 0.2, 0.2, 0.4, 0.1)
_ATTEMPTS = 20
_MOST = {"alpha": 0.21, "beta": 0.26, "phi": 1.2, "theta": 0.6}  # rad from the start: beyond, no one would fly on
_DEG = np.pi / 180.0

Structure = Mapping[str, Sequence[str]]


def cases_of(of: str) -> tuple[str, ...]:
    """Cases of one of SETS."""
    own = {one.NAME: one.CASES for one in (independent, strips, rotors)}
    return own.get(of, CASES)


def set_name(of: str, case: str, seed: int, size: float = 1.0) -> str:
    """Name of a set's folder and answer; it does not tell what is inside."""
    return hashlib.sha256(f"{of} {case} {seed} {size:g}".encode()).hexdigest()[:10]


def hide(of: str, case: str, seed: int, sets: str | Path, answers: str | Path, size: float = 1.0) -> str:
    """Fly a set, write its records and aircraft file below `sets` and its answer below `answers`; returns its name.

    of, case   one of SETS and of its `cases_of`;  size  factor on the size that is drawn
    Raises InputError for an unknown set or case, and without jsbsim for "jsbsim".
    """
    flown = fly_set(of, case, seed, size)
    name = set_name(of, case, seed, size)
    folder = Path(sets) / name
    folder.mkdir(parents=True, exist_ok=True)
    Path(answers).mkdir(parents=True, exist_ok=True)
    for record in flown.records:
        write_record(rounded(record), folder / f"{record.name}.csv")
    flown.aircraft.write(folder / "aircraft.toml")
    flown.answer.write(Path(answers) / f"{name}.json")
    return name


def generate(task: Mapping[str, Any]) -> str:
    """`hide` for a campaign: a task has its arguments."""
    return hide(**task)


@dataclass(frozen=True, eq=False, kw_only=True)
class Set:
    """What a solver gets, `records` and `aircraft`, and what it does not."""

    records: tuple[Record, ...]
    aircraft: Aircraft
    answer: Answer


def fly_set(of: str, case: str, seed: int, size: float = 1.0, structure: Structure | None = None) -> Set:
    """The set of a case and a seed: the same ones give the same numbers, but for the size of what is hidden.

    structure   coefficient -> terms by which the model can imitate what is hidden in its aerodynamics; without it,
                those that the aircraft file of the set has
    """
    if of not in SETS:
        raise unknown("set", of, SETS)
    if case not in cases_of(of):
        raise unknown("case", case, cases_of(of))
    if of in _ONE_SIZE and size != 1.0:
        raise InputError(f"sets of '{of}' have one size; expected 1, got {size:g}")
    if of == independent.NAME or of in _ONE_SIZE:
        flown = _ONE_SIZE[of](case, seed) if of in _ONE_SIZE else independent.flight(case, seed, size)
        records, aircraft, answer = flown
        return Set(records=records, aircraft=aircraft, answer=answer)
    if of.startswith("jsbsim") and find_spec("jsbsim") is None:
        raise InputError("sets of 'jsbsim' need the extra jsbsim; install it: pip install 'casid[jsbsim]'")
    for attempt in range(_ATTEMPTS):
        rng = np.random.default_rng([zlib.crc32(f"{of} {case}".encode()), seed, attempt])
        try:
            return _attempt(of, case, seed, size, structure, rng)
        except InputError:  # it diverges, or leaves the range of a manoeuvre: draw another
            continue
    raise InputError(f"{of}, {case}, seed {seed}: no flyable set in {_ATTEMPTS} attempts; choose another seed")


@dataclass(frozen=True, eq=False, kw_only=True)
class _Plan:
    """How a set is flown: conditions, and the inputs of its four records."""

    rate_hz: float
    noise: float
    seed: int
    durations: tuple[float, ...]
    segments: tuple[tuple[Segment, ...], ...]
    by: Airframe | Flown
    sizes: Mapping[str, float]

    def fly(self, healthy: Sequence[Record], hidden: Sequence[Hidden], outside: Outside | None = None) -> list[Record]:
        """The records at the rate of the simulation, without noise; those that have nothing hidden are `healthy`."""
        records = []
        for i, name in enumerate(RECORDS):
            if healthy and outside is None and not any(name in one.records for one in hidden):
                records.append(healthy[i])
                continue
            t = np.arange(round(self.durations[i] * RATE_HZ) + 1) / RATE_HZ
            deviations = histories(self.segments[i], t, self.sizes)
            if isinstance(self.by, Flown):
                record = self.by.fly(name, t, deviations, hidden, outside, self.seed + i)
            else:
                record = blind_jsbsim.fly(self.by, name, deviations, hidden, outside, self.seed + i)[1]
            for channel, most in _MOST.items():
                if not np.abs(record[channel] - record[channel][0]).max() < most:
                    raise InputError(f"record {name}: {channel} leaves the range of a manoeuvre")
            records.append(record)
        return records


def _plan(of: str, case: str, seed: int, rng: np.random.Generator) -> _Plan:
    aircraft = of.removesuffix(WITH_INSTRUMENTS)
    by = _FLOWN[aircraft]() if aircraft in _FLOWN else _of_the_fleet(case, seed, rng)
    amplitude = float(rng.uniform(0.85, 1.15))
    durations = tuple(float(round(d)) for d in rng.uniform(21.0, 30.0, len(RECORDS)))
    throttled = rng.random(len(RECORDS)) < 0.6
    throttled[rng.integers(len(RECORDS) - 1)] = True
    return _Plan(
        rate_hz=float(rng.choice(_RATES_HZ, p=_RATE_ODDS)),
        noise=float(np.exp(rng.uniform(np.log(0.5), np.log(1.8)))),
        seed=int(rng.integers(2**31)),
        durations=durations,
        by=by,
        segments=tuple(draw_segments(rng, d, by.units_s, bool(t)) for d, t in zip(durations, throttled, strict=True)),
        sizes={name: amplitude * size for name, size in by.sizes.items()},
    )


def _of_the_fleet(case: str, seed: int, rng: np.random.Generator) -> Airframe:
    able = [fleet_airframe(n) for n in (DEVELOPMENT if seed < REPORTING_FROM else REPORTING)]
    if case == "configuration_change":
        able = [one for one in able if one.configuration]
    return able[rng.integers(len(able))]


def _attempt(of: str, case: str, seed: int, size: float, structure: Structure | None, rng: np.random.Generator) -> Set:
    plan = _plan(of, case, seed, rng)
    healthy = plan.fly((), ())
    scene, bare, found = _scene(plan, healthy)
    hidden, outside = _hidden(case, scene if structure is None else replace(scene, structure=structure), rng)
    hidden = tuple(one.scaled(size) for one in hidden)
    outside = replace(outside, size=size * outside.size) if outside else None
    flown = healthy
    if hidden:
        inside = [one for one in hidden if one.kind in KINDS]
        flown = plan.fly(healthy, inside, outside)
    for one in hidden:
        if one.kind == "sensor_drift":
            flown = [_drifting(record, one) for record in flown]
    hidden = tuple(_as_flown(one, plan) for one in hidden)
    noise = np.random.default_rng([plan.seed, 4])
    installed = Instruments.drawn(np.random.default_rng([plan.seed, 5])) if of.endswith(WITH_INSTRUMENTS) else None
    answer = Answer(
        of=of,
        case=case,
        seed=seed,
        size=size,
        aircraft=bare.name,
        hidden=hidden,
        mismatch={c: float(f"{np.sqrt(max(1.0 - r2, 0.0)):.3g}") for c, r2 in found.R2.items()},
        conditions={
            "rate_hz": plan.rate_hz,
            "noise": round(plan.noise, 3),
            "durations_s": plan.durations,
            "structure": {c: list(t) for c, t in scene.structure.items()},
            **({} if installed is None else {"instruments": asdict(installed)}),
        },
        values={f"{c}_{term}": v for c, terms in found.values.items() for term, v in terms.items()},
    )
    return Set(
        records=tuple(_recorded(record, plan, noise, installed) for record in flown),
        aircraft=guessed(bare, found, plan.seed, _OFF),
        answer=answer,
    )


def _scene(plan: _Plan, healthy: Sequence[Record]) -> tuple[Scene, Aircraft, Regression]:
    """The flight to hide something in, the aircraft without aerodynamics, and its exact aerodynamics."""
    if isinstance(plan.by, Flown) and plan.by.aircraft.aerodynamics is None:
        bare = plan.by.aircraft
        values = {c: _by_term(bare, c) for c in bare.coefficients}
        found = Regression(values=values, R2=dict.fromkeys(values, 1.0))
        structure = {c: tuple(terms) for c, terms in values.items()}
    elif isinstance(plan.by, Flown):
        bare = f16.without_aerodynamics(plan.by)
        structure, found = demanded(bare, [_thinned(r) for r in healthy])
    else:
        log, record = blind_jsbsim.fly(plan.by, "trim", {name: np.zeros(20) for name in (*SURFACES, "throttle")})
        bare = geometry(plan.by.name, log, record)
        structure, found = demanded(bare, [_thinned(r) for r in healthy])
    scene = Scene(
        aircraft=bare,
        records=tuple(_thinned(r) for r in healthy),
        structure=structure,
        sizes=plan.sizes,
        configuration={} if isinstance(plan.by, Flown) else plan.by.configuration_steps,
        free_steps=isinstance(plan.by, Flown),
    )
    return scene, bare, found


def _by_term(aircraft: Aircraft, coefficient: str) -> dict[str, float]:
    found = {n.split("_", 1)[1]: v for n, v in aircraft.derivatives.items() if n.split("_", 1)[0] == coefficient}
    return {term: value for term, value in found.items() if value != 0.0 or term == "0"}


def _thinned(record: Record) -> Record:
    return replace(record, t=record.t[::4], channels={name: x[::4] for name, x in record.channels.items()})


def _hidden(case: str, scene: Scene, rng: np.random.Generator) -> tuple[tuple[Hidden, ...], Outside | None]:
    if case.startswith("clean"):
        return (), None
    if case.startswith("two"):
        return draw_two(rng, scene), None
    if case in KINDS:
        return (draw_effect(rng, case, scene),), None
    if case == "sensor_drift":
        sizes = {"beta": 0.8 * _DEG, "alpha": 0.8 * _DEG, "theta": 1.0 * _DEG, "ay": 0.25, "q": 0.4 * _DEG}
        channel = str(rng.choice(list(sizes)))
        value = float(f"{rng.uniform(0.7, 1.5) * sizes[channel]:.4g}")
        parameters = {"period_s": float(rng.uniform(12.0, 25.0)), "phase": float(rng.uniform(0.0, 6.28))}
        return (Hidden(kind=case, target=channel, value=value, parameters=parameters),), None
    outside = _outside(case, scene, rng)
    parameters = {"frequency_hz": outside.frequency_hz, "threshold": outside.threshold}
    return (Hidden(kind=case, target=outside.target, value=outside.size, parameters=parameters),), outside


def _outside(case: str, scene: Scene, rng: np.random.Generator) -> Outside:
    """A law of size 1 along the healthy flight decides the size: 15 to 35 % of its main coefficient's variation."""
    target = {"rotor_gyroscope": "Cm", "fuel_slosh": "Cl", "stall_break": "Cl"}.get(
        case, str(rng.choice(("Cl", "Cm", "Cn")))
    )
    slow = case == "fuel_slosh"
    law = Outside(
        kind=case,
        target=target,
        size=1.0,
        V=scene.V,
        phase=float(rng.uniform(0.0, 6.28)),
        frequency_hz=float(f"{rng.uniform(0.45, 0.8) if slow else rng.uniform(1.8, 4.0):.3g}"),
        threshold=float(np.quantile(np.concatenate([r["alpha"] for r in scene.records]), 0.93)),
    )
    parts = [along(law, r.t, {n: r[n] for n in SIGNALS})[target] for r in scene.records]
    _, share = scene.size_of_share(target, np.concatenate(parts), 1.0)
    if share < 0.1:
        raise InputError(f"'{case}' would be mistaken for derivatives here")
    value = rng.uniform(0.15, 0.35) * np.std(scene.coefficients[target]) / np.std(np.concatenate(parts))
    return replace(law, size=float(f"{value:.4g}"))


def _drifting(record: Record, hidden: Hidden) -> Record:
    shift = list(RECORDS).index(record.name)
    series = drift(record.t, hidden.parameters["period_s"], hidden.parameters["phase"] + 1.3 * shift)
    return record.with_channels(**{hidden.target: record[hidden.target] + hidden.value * series})


def _as_flown(hidden: Hidden, plan: _Plan) -> Hidden:
    """Turbulence has the r.m.s. velocity that was met in these records, per axis; a spectrum only promises it."""
    if hidden.kind != "turbulence":
        return hidden
    squares = []
    for i, name in enumerate(RECORDS):
        t = np.arange(round(plan.durations[i] * RATE_HZ) + 1) / RATE_HZ
        if isinstance(plan.by, Flown):
            met = plan.by.air(t, hidden.value, plan.seed + i)
            squares += [np.mean(met[f"wind_{axis}"] ** 2) for axis in "xyz"]
        else:
            still = {n: np.zeros_like(t) for n in (*SURFACES, "throttle")}
            log, _ = blind_jsbsim.fly(plan.by, name, still, [hidden], None, plan.seed + i)
            squares += [np.mean(log.channels[f"turb_{axis}"] ** 2) for axis in "xyz"]
    return replace(hidden, value=float(f"{np.sqrt(np.mean(squares)):.4g}"))


def _recorded(record: Record, plan: _Plan, rng: np.random.Generator, installed: Instruments | None) -> Record:
    """What is written down: sampled, with noise on every channel that has any, by ideal instruments or as they are."""
    if installed is not None:
        return installed.recorded(record, plan.rate_hz, plan.noise, rng)
    every = round(RATE_HZ / plan.rate_hz)
    sampled = {}
    for name, values in record.channels.items():
        if name not in NOISE:
            continue
        sigma = plan.noise * NOISE[name] * (float(np.mean(values)) if name == "thrust" else 1.0)
        sampled[name] = values[::every] + sigma * rng.standard_normal(len(values[::every]))
    return Record(name=record.name, t=np.round(record.t[::every], 6), channels=sampled, source="simulated")
