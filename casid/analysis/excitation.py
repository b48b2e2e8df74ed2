"""Describe how the inputs of records moved, and which manoeuvre is most informative about a combination of
parameters."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from casid.errors import InputError
from casid.estimation.attempt import build_objective
from casid.estimation.cost import OutputError
from casid.estimation.fit import Fit
from casid.estimation.initial_state import of_record
from casid.estimation.problem import Problem
from casid.estimation.solvers.point import Point
from casid.estimation.transcriptions.transcription import MultipleShooting
from casid.model.simulate import Simulation, simulate
from casid.model.system import bare_name
from casid.records.record import Record
from casid.signals import label_of, unit_of

_RESTING = 0.05  # of the largest excursion of any control: less is noise or trim
_RESOLVED = 1.2  # over the record's resolution: 80 % of the power of a single sine lies within less
_UNITS_S = (0.25, 0.5, 1.0, 2.0)  # duration of the shortest pulse of a manoeuvre tried
_FORMS = {"doublet": ((1, 1.0), (1, -1.0)), "3-2-1-1": ((3, 1.0), (2, -1.0), (1, 1.0), (1, -1.0))}
# of a manoeuvre; times the range of the states in the records
_LONGEST_S = 20.0
_FARTHEST = 3.0
_WORTH = 1.2  # factor that a suggested manoeuvre must gain


@dataclass(frozen=True, eq=False, kw_only=True)
class Suggestion:
    """A manoeuvre that could be flown: `form` on `control` with pulses of `unit_s` [s] and `amplitude` (SI) about the
    first sample, and the information (shared, shared) that its record would bring. `gain` is the factor by which the
    uncertainty of a direction falls with that record added."""

    control: str
    form: str
    unit_s: float
    amplitude: float
    record: Record
    information: np.ndarray
    gain: float = math.nan

    @property
    def manoeuvre(self) -> str:
        size = f"{self.amplitude:.3g} {unit_of(self.control)}".rstrip()
        return f"a {self.form} on {self.control} with pulses of {self.unit_s:g} s and {size}"

    @property
    def sentence(self) -> str:
        gain = f"{self.gain:.1f} times" if self.gain < 1e4 else "many thousand times"
        return f"{self.manoeuvre} would make that {gain} more certain"


@dataclass(frozen=True, kw_only=True)
class Excitation:
    """Motion of a control: largest excursion `move` (SI), and the frequencies [Hz] between which 80 % of its power
    lies, NaN when it rested; `resolution` [Hz] is one over the longest record."""

    control: str
    move: float
    low: float
    high: float
    resolution: float

    @property
    def poor(self) -> bool:
        """Return True if it rested, or moved within an octave or what a record of this length cannot resolve."""
        return not (self.high >= 2.0 * self.low and self.high - self.low > _RESOLVED * self.resolution)

    @property
    def sentence(self) -> str:
        if not self.high > 0.0:
            return self.in_short
        words = f"{self._who} moved by {self.move:.3g} {unit_of(self.control)}".rstrip()
        return f"{words}, 80 % of its power {self._where}"

    @property
    def in_short(self) -> str:
        return f"{self._who} moved {self._where}" if self.high > 0.0 else f"{self._who} did not move"

    @property
    def _who(self) -> str:
        return " ".join(dict.fromkeys((label_of(self.control), self.control)))

    @property
    def _where(self) -> str:
        if self.poor:
            return f"at {0.5 * (self.low + self.high):.2g} Hz only"
        return f"between {self.low:.2g} and {self.high:.2g} Hz"


def excitations(records: Sequence[Record], controls: Sequence[str]) -> tuple[Excitation, ...]:
    """Describe how each control moved in the records together."""
    moves = _moves(records, controls)
    largest = max(moves.values(), default=0.0)
    resolution = 1.0 / max(record.duration for record in records)
    found = []
    for name, move in moves.items():
        low, high = _band(records, name) if move > _RESTING * largest else (math.nan, math.nan)
        found.append(Excitation(control=name, move=move, low=low, high=high, resolution=resolution))
    return tuple(found)


def _moves(records: Sequence[Record], controls: Sequence[str]) -> dict[str, float]:
    """Return the largest excursion of each control in all records."""
    series = {name: [record[name] for record in records] for name in controls}
    return {n: max(float(np.nanmax(np.abs(y - np.nanmedian(y)))) for y in some) for n, some in series.items()}


def _band(records: Sequence[Record], name: str) -> tuple[float, float]:
    """Frequencies [Hz] below which a tenth and nine tenths of the power of a channel's motion lie."""
    frequency = []
    power = []
    for record in records:
        t = np.arange(record.t[0], record.t[-1], record.dt)
        values = np.interp(t, record.t, record[name])
        count = 4 * len(values)  # zeros appended: a record of few periods has its peak between the lines
        frequency.append(np.fft.rfftfreq(count, record.dt)[1:])
        power.append(np.abs(np.fft.rfft(values - values.mean(), count)[1:]) ** 2 * record.dt / count)
    order = np.argsort(np.concatenate(frequency))
    at = np.concatenate(frequency)[order]
    total = np.cumsum(np.concatenate(power)[order])
    low, high = np.searchsorted(total, [0.1 * total[-1], 0.9 * total[-1]])
    return float(at[low]), float(at[min(high, len(at) - 1)])


def best_manoeuvre(found: Sequence[Suggestion], information: np.ndarray, coordinate: np.ndarray) -> Suggestion | None:
    """The candidate that, added to the fit's data of this information (parameters, parameters), makes a linear function
    `coordinate` (parameters,) of the parameters most certain; None when none gains a fifth."""
    floor = 1e-12 * np.diag(np.maximum(np.diagonal(information), 1e-12))
    before = coordinate @ np.linalg.solve(information + floor, coordinate)
    best: Suggestion | None = None
    for c in found:
        whole = information + floor
        whole[: len(c.information), : len(c.information)] += c.information
        gain = float(np.sqrt(before / (coordinate @ np.linalg.solve(whole, coordinate))))
        if gain > max(_WORTH, best.gain if best else 0.0):
            best = replace(c, gain=gain)
    return best


def candidates(fit: Fit, controls: Sequence[str]) -> Iterator[Suggestion]:
    """Doublets and 3-2-1-1 with several durations on every control, from the first sample of the first record.

    They are as large as in the records, or as the control that moved most; what leaves three times the range of the
    records' states is left out. Empty for what cannot be flown here: equation error, a control law in the loop.
    """
    problem = fit.problem
    if not problem.simulated or problem.feedback is not None:
        return
    model = fit.problem.model
    first = problem.records[0]
    t = np.arange(0.0, min(first.duration, _LONGEST_S) + 0.5 * first.dt, first.dt)
    start = fit.states[first.name].trajectory[0]
    flown = np.concatenate([fit.states[record.name].trajectory for record in problem.records])
    room = _FARTHEST * np.maximum(np.abs(flown - start).max(axis=0), 0.1 * model.scale_vector())
    moves = _moves(problem.records, controls)
    largest = max(moves.values(), default=0.0)
    theta = np.array(list(fit.values.values()))
    parameters = dict(zip(model.parameters, problem.model_parameters(theta)[0].tolist(), strict=True))
    for control in controls:
        amplitude = moves[control] if moves[control] > _RESTING * largest else largest
        for form, pulses in _FORMS.items():
            for unit in _UNITS_S:
                if 1.0 + unit * sum(length for length, _ in pulses) > t[-1]:
                    continue
                channels = {name: np.full(len(t), first[name][0]) for name in model.inputs}
                channels[control] = channels[control] + amplitude * _pulses(t - 1.0, unit, pulses)
                record = Record(name="suggested", t=t, channels=channels, hold=first.hold)
                try:
                    motion = simulate(model, record, start, parameters)
                except InputError:
                    continue  # it departs
                if (np.abs(motion.states - start) <= room).all():
                    yield Suggestion(
                        control=control,
                        form=form,
                        unit_s=unit,
                        amplitude=amplitude,
                        record=motion.as_record(),
                        information=_information(fit, motion),
                    )


def _pulses(t: np.ndarray, unit: float, pulses: Sequence[tuple[int, float]]) -> np.ndarray:
    ends = unit * np.cumsum([0, *(length for length, _ in pulses)])
    signs = np.array([0.0, *(sign for _, sign in pulses), 0.0])
    return signs[np.searchsorted(ends - 1e-9, t, side="right")]


def _information(fit: Fit, motion: Simulation) -> np.ndarray:
    """(shared, shared) information of a simulated flight of which the same channels are measured; what the record has
    of its own is eliminated."""
    problem = fit.problem
    model = fit.problem.model
    seen = {o for r in problem.records for o in model.outputs if o in r and np.isfinite(r[o]).any()}
    flown = motion.as_record().without(*(o for o in model.outputs if o not in seen))
    values = {bare_name(fit.problem.model, name): value for name, value in reversed(fit.values.items())}
    alone = Problem(
        model,
        [flown],
        free=problem.free,
        per_record=problem.per_record,
        fixed=problem.fixed_in(""),
        start=values,
        cost=OutputError(),
        noise={o: fit.noise.get(o, 1.0) for o in model.outputs},
        prior=False,
        initial_state=replace(problem.initial_state, value={}, std=of_record(problem.initial_state.std, "")),
    )
    objective = build_objective(alone, MultipleShooting())
    nodes = motion.states[:: objective.layout.length]
    still = np.zeros((len(objective.layout.tied), nodes.shape[1]))
    point = Point(theta=alone.start_vector, nodes=nodes, noise=still)
    hessian = objective.linearise(point, objective.value(point)).hessian
    shared = len(alone.shared)
    inner = hessian[:shared, :shared]
    cross = hessian[:shared, shared:]
    own = hessian[shared:, shared:]
    return inner - cross @ np.linalg.pinv(own, hermitian=True) @ cross.T if len(own) else inner
