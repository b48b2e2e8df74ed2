"""Measure how well a flight separates two explanations, and find the manoeuvre that separates them best.

Were the first effect the true one, the second would imitate it as well as its size, the derivatives and the initial
states can. What it cannot imitate, over the noise, is left: half the sum of its squares is the expected logarithm of
the likelihood ratio (the T-criterion of Atkinson and Fedorov, Biometrika 62, 1975). Nothing is taken as known of the
derivatives, so that the promise is kept whatever they are; that one explanation has more numbers is not counted.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from casid.design.experiment import Experiment
from casid.design.input_shapes import Manoeuvre, flyable
from casid.errors import EstimationError, InputError
from casid.estimation.transcriptions.steps import output_function, sample_derivatives, step_function
from casid.model.aircraft import Aircraft
from casid.model.built import compiled, share_cache
from casid.model.effect_value import EffectValue
from casid.model.effects import effect_of
from casid.model.flown_records import FlownRecords, default_free, flown_records
from casid.model.with_effects import at_own_times
from casid.native.threads import single_threaded
from casid.records.record import Record

_STEPS = 4  # of Gauss-Newton for the imitation
_DIFFERENCE = 0.02  # of its size, for the derivative by an effect
_SLACK = 0.01  # of a limit: what a manoeuvre may exceed it by
_ROUNDS = 8  # of making manoeuvres smaller: 3 suffice where the motion is in proportion to them
_RELATIVE = 1e-9  # of the largest singular value: what an imitation may not use


@dataclass(frozen=True, eq=False, kw_only=True)
class Rivals:
    """Two effects, one of which an aircraft has beside those of its file.

    Raises
    ------
    InputError
        For an effect that no manoeuvre can bring back, an event or turbulence.
    """

    aircraft: Aircraft
    first: EffectValue  # first, second: the effects with their sizes; the second is refitted, the first is not
    second: EffectValue
    axes: str  # of the model: "full", "longitudinal" or "lateral"
    noise: Mapping[str, float]  # measured channel -> 1-sigma

    def __post_init__(self) -> None:
        for value in (self.first, self.second):
            effect = effect_of(value)
            if effect.timed or effect.stochastic:
                raise InputError(f"{effect.name}: an event or turbulence; no manoeuvre can bring it about")


@dataclass(frozen=True, eq=False, kw_only=True)
class _Flights:
    """Records that rivals fly; the models of both are made once for all of them."""

    rivals: Rivals
    records: Sequence[Record]
    _made: dict[tuple[str, float], FlownRecords] = field(default_factory=dict)
    _models: dict[str, FlownRecords] = field(default_factory=dict)

    def flying(self, records: Sequence[Record]) -> _Flights:
        """The same rivals on other records."""
        return replace(self, records=records, _made={})

    def of(self, value: EffectValue) -> FlownRecords:
        """The aircraft with one of the effects, and the records made ready for it."""
        name = effect_of(value).name
        if name not in self._models:
            aircraft = replace(self.rivals.aircraft, effects=(*self.rivals.aircraft.effects, value))
            self._models[name] = flown_records(aircraft, self.records, self.rivals.axes, tuple(self.rivals.noise))
        if (name, value.value) not in self._made:
            like = self._models[name]
            nominal = {**like.model.nominal, name: value.value}
            model = share_cache(replace(like.model, nominal=nominal), like.model)
            records = tuple(map(model.ready, self.records))
            self._made[name, value.value] = replace(like, model=model, records=records)
        return self._made[name, value.value]

    @property
    def sigma(self) -> np.ndarray:
        """(channels,) 1-sigma of the noise."""
        return np.array(list(self.rivals.noise.values()))

    @property
    def truth(self) -> list[np.ndarray]:
        """Readings of the instruments with the first effect, (N, channels) of each record."""
        applied = self.of(self.rivals.first)
        return [_flown(applied, r) for r in range(len(self.records))]


@dataclass(frozen=True, eq=False, kw_only=True)
class Separation:
    """Power of a flight to separate two rivals."""

    log_odds: float  # expected logarithm of the likelihood ratio in favour of the true one
    told: Mapping[str, float]  # channel -> its part of that
    # first, second: record -> (N, channels) what the instruments would read with the first; and with the second where
    # it imitates the first as well as it can
    first: Mapping[str, np.ndarray]
    second: Mapping[str, np.ndarray]

    @property
    def scatter(self) -> float:
        """1-sigma, at most, of the log likelihood ratio from flight to flight, both fitted: what cannot be imitated
        meets noise of variance twice `log_odds`, and each fit takes up noise along one direction, of variance 1 at
        most."""
        return float(np.sqrt(2.0 * self.log_odds + 1.0))

    @property
    def tells_apart(self) -> bool:
        """Return True if it separates the two well enough to mention (Jeffreys: odds of 3)."""
        return self.log_odds >= math.log(3.0)


@single_threaded()
def separation(rivals: Rivals, records: Sequence[Record]) -> Separation:
    """Measure how well flights with the inputs of these records separate the rivals; each begins in its first
    measured state."""
    flights = _Flights(rivals=rivals, records=tuple(records))
    return _imitated(flights, flights.truth, range(len(records)))


@dataclass(frozen=True, eq=False, kw_only=True)
class NextFlight:
    """The manoeuvre that separates two rivals best, of `amplitude` [rad], its record, and the separation by it."""

    manoeuvre: Manoeuvre
    amplitude: float
    record: Record
    separation: Separation

    @property
    def flown(self) -> Record:
        """The record as the instruments would read it with the first effect, without noise."""
        (read,) = self.separation.first.values()
        return self.record.with_channels(**dict(zip(self.separation.told, read.T, strict=True)))


@dataclass(frozen=True, kw_only=True)
class NoManoeuvre:
    """No manoeuvre stays within the limits, and why."""

    reason: str


@single_threaded()
def separating_manoeuvre(rivals: Rivals, experiment: Experiment) -> NextFlight | NoManoeuvre:
    """Return the flyable manoeuvre, as large as the limits allow, that separates the rivals best, or why there is none.

    The number of simulations is bounded by the number of flyable manoeuvres, whatever the aircraft does."""
    within = _within_limits(rivals, experiment)
    if isinstance(within, NoManoeuvre):
        return within
    choice, sizes, flights = within
    truth = flights.truth
    other = flights.of(rivals.second)
    plain = [_flown(other, r) for r in range(len(choice))]
    # an imitation only takes away: no manoeuvre separates better than without one
    most = [0.5 * float(np.sum(((a - b) / flights.sigma) ** 2)) for a, b in zip(truth, plain, strict=True)]
    best = -1
    found = -1.0
    for k in sorted((k for k in range(len(choice)) if np.isfinite(most[k])), key=lambda k: -most[k]):
        if most[k] <= found:
            break
        told = _imitated(flights, truth, [k], steps=1).log_odds
        if told > found:
            best = k
            found = told
    if best < 0:
        return NoManoeuvre(reason=f"with {effect_of(rivals.second).name} every manoeuvre within these limits diverges")
    record = flights.records[best]
    told = _imitated(flights, truth, [best])
    return NextFlight(manoeuvre=choice[best], amplitude=sizes[best], record=record, separation=told)


def _within_limits(
    rivals: Rivals, experiment: Experiment
) -> tuple[list[Manoeuvre], list[float], _Flights] | NoManoeuvre:
    """Return the manoeuvres that can be flown with the first, their amplitudes, as large as surface and limits allow,
    and their flights."""
    rest = _at_rest(experiment)
    outputs = list(rivals.noise)
    flights = _Flights(rivals=rivals, records=(rest,))
    drift = _used(experiment, outputs, flights.truth[0])
    for name, part in drift.items():
        if not part < 1.0:
            grown = f"{name} changes by {part:.3g} times its limit" if np.isfinite(part) else "the flight diverges"
            why = f"with {effect_of(rivals.first).name} and all surfaces at rest {grown} in {experiment.duration:g} s"
            return NoManoeuvre(reason=f"{why}; widen the limit or shorten the time")
    choice = list(flyable(experiment))
    sizes = [experiment.surfaces[one.surface] for one in choice]
    kept: dict[int, Record] = {}
    for _ in range(_ROUNDS):
        left = [k for k in range(len(choice)) if k not in kept]
        if not left:
            break
        flights = flights.flying([_commanded(rest, choice[k], sizes[k]) for k in left])
        for k, record, flown in zip(left, flights.records, flights.truth, strict=True):
            used = _used(experiment, outputs, flown)
            if all(part < 1.0 + _SLACK for part in used.values()):
                kept[k] = record
            sizes[k] *= 1.0 if k in kept else _share(used, drift)
    if not kept:
        return NoManoeuvre(reason="a manoeuvre of any size leaves these limits; widen them")
    found = sorted(kept)
    return [choice[k] for k in found], [sizes[k] for k in found], flights.flying([kept[k] for k in found])


def _at_rest(experiment: Experiment) -> Record:
    """Return what instruments read as long as nothing moves: the first sample, since an unstable aircraft leaves it."""
    first = replace(experiment, duration=11 * experiment.dt).record({}, "rest")
    held = {name: np.full(len(experiment.t), first[name][0]) for name in first.channels}
    return replace(first, t=experiment.t, channels=held)


def _used(experiment: Experiment, outputs: Sequence[str], flown: np.ndarray) -> dict[str, float]:
    """Return the part of each limit that a flight uses; NaN where it diverges."""
    moved = np.abs(flown - flown[0]).max(axis=0) if np.isfinite(flown).all() else np.full(len(outputs), np.nan)
    return {n: float(moved[outputs.index(n)]) / limit for n, limit in experiment.limits.items() if n in outputs}


def _share(used: Mapping[str, float], drift: Mapping[str, float]) -> float:
    """Return the part of a manoeuvre that meets the first limit, were the motion beside the drift at rest in proportion
    to it; a half where the flight diverges."""
    return min(
        (1.0 - drift[n]) / (part - drift[n]) if np.isfinite(part) else 0.5
        for n, part in used.items()
        if not part <= 1.0
    )


def _commanded(rest: Record, one: Manoeuvre, amplitude: float) -> Record:
    """The inputs of a manoeuvre, and what instruments read at `rest`."""
    moved = rest.with_channels(**{one.surface: rest[one.surface] + amplitude * one.moves})
    return replace(moved, name=f"{one.surface}, {one.words}")


def _start(applied: FlownRecords, r: int) -> np.ndarray:
    return np.asarray(applied.model.guess(applied.records[r])[0], dtype=float)


def _flown(
    applied: FlownRecords, r: int, values: Mapping[str, float] | None = None, start: np.ndarray | None = None
) -> np.ndarray:
    """(N, channels) what the instruments read; not finite where the flight diverges."""
    _, outputs = _trajectory(applied, r, applied.model.nominal_vector(values), start)
    return at_own_times(applied.model, applied.records[r], outputs)


def _trajectory(
    applied: FlownRecords, r: int, p: np.ndarray, start: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """(N, states) and (N, outputs) of a flight with the inputs of a record."""
    model = applied.model
    record = applied.records[r]
    U = record.matrix(model.inputs)
    count = len(record)
    x0 = _start(applied, r) if start is None else start
    run = compiled(model, step_function).accumulated(count - 1, 1)
    (after,) = run(x0, U[:-1], record.following(model.inputs), np.diff(record.t), np.tile(p, (count - 1, 1)))
    states = np.vstack([x0, after])
    (read,) = compiled(model, output_function).mapped(count)(states, U, np.tile(p, (count, 1)))
    return states, read.copy()


def _columns(applied: FlownRecords, r: int, p: np.ndarray, start: np.ndarray, free: np.ndarray) -> np.ndarray:
    """(N, outputs, states + free) derivatives of the outputs by initial state and free parameters."""
    model = applied.model
    record = applied.records[r]
    states, _ = _trajectory(applied, r, p, start)
    U = record.matrix(model.inputs)
    count = len(record)
    n = len(model.states)
    after = np.vstack([record.following(model.inputs), U[-1:]])
    derivatives = compiled(model, sample_derivatives, tuple(free.tolist()), ()).mapped(count)
    found = derivatives(states, U, after, np.r_[np.diff(record.t), 0.0], np.tile(p, (count, 1)))
    A, B, _, C, D = (part.reshape(count, len(part) // count, part.shape[1]) for part in found)
    S = np.zeros((count, n, n + len(free)))  # derivatives of the states
    S[0, :, :n] = np.eye(n)
    for k in range(count - 1):
        np.matmul(A[k], S[k], out=S[k + 1])
        S[k + 1, :, n:] += B[k]
    columns = C @ S
    columns[..., n:] += D
    return columns


def _imitated(flights: _Flights, truth: Sequence[np.ndarray], which: Sequence[int], steps: int = _STEPS) -> Separation:
    """Return what is left when the second imitates the `truth` in `which` of the records, by Gauss-Newton from its
    own size and its own starts; the best of all steps counts."""
    second = flights.rivals.second
    values = {}
    best = None
    starts = {r: _start(flights.of(second), r) for r in which}
    for step in range(steps + 1):
        applied = flights.of(second)
        flown = {r: _flown(applied, r, values, starts[r]) for r in which}
        left = {r: (truth[r] - flown[r]) / flights.sigma for r in which}
        if not all(np.isfinite(one).all() for one in left.values()):
            break
        now = _told(flights, left, truth, flown)
        best = now if best is None or now.log_odds < best.log_odds else best
        if step == steps:
            break
        free = default_free(applied)
        moved, remaining = _step(flights, second, values, starts, left, flown)
        if steps == 1:
            return replace(best, log_odds=min(best.log_odds, 0.5 * remaining))
        second = replace(second, value=second.value + moved[0])
        p = {**applied.model.nominal, **values}
        values = {name: p[name] + d for name, d in zip(free, moved[1 : 1 + len(free)], strict=True)}
        changes = moved[1 + len(free) :].reshape(len(which), -1)
        starts = {r: x0 + d for (r, x0), d in zip(starts.items(), changes, strict=True)}
    if best is None:
        raise EstimationError(f"{effect_of(second).name}: its flight diverges; give it another size")
    return best


def _step(
    flights: _Flights,
    second: EffectValue,
    values: Mapping[str, float],
    starts: Mapping[int, np.ndarray],
    left: Mapping[int, np.ndarray],
    flown: Mapping[int, np.ndarray],
) -> tuple[np.ndarray, float]:
    """Changes of (size of the second, derivatives, initial states of each record) that imitate best in the linear, and
    the sum of squares that they leave. An imitation has derivatives `values`, initial states `starts`, flights `flown`,
    and what is `left` over the noise."""
    further = _DIFFERENCE * (second.value or 1.0)
    applied = flights.of(second)
    more = flights.of(replace(second, value=second.value + further))
    model = applied.model
    n = len(applied.model.states)
    index = np.array([model.parameters.index(name) for name in default_free(applied)], dtype=int)
    p = model.nominal_vector(values)
    blocks = []
    for place, (r, start) in enumerate(starts.items()):
        by_size = (_flown(more, r, values, start) - flown[r]) / further / flights.sigma
        by_rest = _columns(applied, r, p, start, index) / flights.sigma[:, None]
        block = np.zeros((by_size.size, 1 + len(index) + n * len(starts)))
        block[:, 0] = by_size.reshape(-1)
        block[:, 1 : 1 + len(index)] = by_rest[..., n:].reshape(by_size.size, -1)
        first = 1 + len(index) + n * place
        block[:, first : first + n] = by_rest[..., :n].reshape(by_size.size, -1)
        blocks.append(block)
    J = np.vstack(blocks)
    z = np.concatenate([one.reshape(-1) for one in left.values()])
    size = np.maximum(np.linalg.norm(J, axis=0), 1e-300)
    scaled, *_ = np.linalg.lstsq(J / size, z, rcond=_RELATIVE)
    return scaled / size, float(np.sum((z - (J / size) @ scaled) ** 2))


def _told(
    flights: _Flights, left: Mapping[int, np.ndarray], truth: Sequence[np.ndarray], flown: Mapping[int, np.ndarray]
) -> Separation:
    parts = 0.5 * np.sum([np.sum(one**2, axis=0) for one in left.values()], axis=0)
    return Separation(
        log_odds=float(parts.sum()),
        told=dict(zip(flights.rivals.noise, parts.tolist(), strict=True)),
        first={flights.records[r].name: truth[r] for r in flown},
        second={flights.records[r].name: series for r, series in flown.items()},
    )
