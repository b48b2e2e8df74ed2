"""The model with the named causes, and records prepared for it, for further simulations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import casadi as ca
import numpy as np

from casid.diagnosis.flight.evaluation import FlightFit
from casid.diagnosis.flight.fit import fit
from casid.diagnosis.flight.hypothesis import Attached, disturbance_series
from casid.diagnosis.flight.noise import free_simulation
from casid.diagnosis.systems.plant import Draft, Plant, as_flight
from casid.errors import InputError
from casid.model import operators
from casid.model.station import control
from casid.model.system import Model
from casid.records.record import Record


@dataclass(frozen=True, eq=False, kw_only=True)
class Flown:
    """Open-loop simulations of records with fitted initial states: output -> r.m.s. residual over noise; and record ->
    output -> simulated reading (N,), without records on which it diverges.
    """

    records: tuple[str, ...]
    rms: Mapping[str, float]
    readings: int
    simulated: Mapping[str, Mapping[str, np.ndarray]]

    @property
    def log_likelihood(self) -> float:
        """Per reading, without its constant."""
        return -0.5 * float(np.mean([v**2 for v in self.rms.values()]))


def flown(held: FlightFit) -> Flown:
    """The model of a fit of initial states on records, flown from there."""
    with np.errstate(all="ignore"):
        simulated = free_simulation(held)
    seen = np.isfinite(held.batch.Z) & held.batch.live[..., None]
    output, records = simulated.output, held.flight.records
    residual = np.where(seen, held.batch.Z - np.where(seen, output, 0.0), 0.0)
    names = held.model.outputs
    there = {name: seen[..., i] for i, name in enumerate(names) if seen[..., i].any()}
    with np.errstate(over="ignore"):
        rms = {
            name: float(np.sqrt(np.mean(residual[..., names.index(name)][at] ** 2))) / held.noise.measurement[name]
            for name, at in there.items()
        }
    return Flown(
        records=tuple(record.name for record in records),
        rms=rms,
        readings=int(seen.sum()),
        simulated={
            record.name: {name: output[: len(record), r, i] for i, name in enumerate(names)}
            if np.isfinite(output[: len(record), r]).all()
            else {}
            for r, record in enumerate(records)
        },
    )


def as_given(plant: Plant, records: Sequence[Record]) -> Flown:
    """The model with its nominal values, simulated on records; errors are infinite if it cannot follow them at all."""
    held = as_flight(plant.elsewhere({}, records))
    try:
        with np.errstate(all="ignore"):
            return flown(fit(held, (), held.noise(), free="states", iterations=6, tolerance=1.0))
    except InputError:
        there = {name: [r for r in records if name in r and np.isfinite(r[name]).any()] for name in plant.outputs}
        return Flown(
            records=tuple(record.name for record in records),
            rms={name: np.inf for name, of in there.items() if of},
            readings=sum(int(np.isfinite(r[name]).sum()) for name, of in there.items() for r in of),
            simulated={record.name: {} for record in records},
        )


@dataclass(frozen=True, eq=False, kw_only=True)
class Extended:
    """A model with causes in it.

    Attributes
    ----------
    base
        The model without them, with fitted values.
    attached
        The causes with their values.
    """

    base: Model
    attached: tuple[Attached, ...]
    terms: Mapping[str, ca.SX]

    @cached_property
    def model(self) -> Model:
        """The extended model: causes in its equations are parameters, a lag of an instrument is a state. A cause of
        some records has an input of its name in brackets, 1 where it is there."""
        draft, base = Draft(self.base, self.terms), self.base
        own = [one for one in self.attached if one.effect.symbolic or one.effect.kind == "sensor_lag"]
        values = {one.name: ca.SX.sym("value") for one in own}
        there = {f"[{one.name}]": ca.SX.sym("there") for one in own if one.effect.symbolic and one.records}
        states: dict[str, tuple[ca.SX, ca.SX]] = {}
        for one in own:
            value, target = values[one.name], one.effect.target
            if one.effect.change is not None:
                one.effect.change(draft, {"value": value * there.get(f"[{one.name}]", 1.0)})
                continue
            state, true = ca.SX.sym("lagged"), draft.h[base.outputs.index(target)]
            states[f"lagged[{target}]"] = state, (true - state) / ca.fabs(value)
            draft.reads(target, lambda y, state=state: state)
        rates = ca.vertcat(draft.f, *[rate for _, rate in states.values()])
        f, h = ca.substitute([rates, draft.h], [base.p], [draft.p])
        sizes = {name: 1.0 for name in states}
        return replace(
            base,
            states=(*base.states, *states),
            inputs=(*base.inputs, *there),
            parameters=(*base.parameters, *values),
            x=ca.vertcat(base.x, *[state for state, _ in states.values()]),
            u=ca.vertcat(base.u, *there.values()),
            p=ca.vertcat(base.p, *values.values()),
            f=f,
            h=h,
            nominal={**base.nominal, **{one.name: one.values["value"] for one in own}},
            state_scale={**base.state_scale, **sizes},
            guess=self._guess,
            equation=None,
        )

    def _guess(self, record: Record) -> np.ndarray:
        """First guess of the states; a lagging instrument as it reads."""
        lagged = [one.effect.target for one in self.attached if one.effect.kind == "sensor_lag"]
        read = [_filled(record, name) for name in lagged]
        return np.column_stack([self.base.guess(record), *read])

    def prepared(self, record: Record) -> Record:
        """The record as the extended model takes it: inputs as they act, readings without their delay, none of an
        instrument that is stuck."""
        channels: dict[str, np.ndarray] = {}
        for one in self.attached:
            effect, target, concerned = one.effect, one.effect.target, one.concerns(record.name)
            if effect.symbolic and one.records:
                channels[f"[{one.name}]"] = np.full(len(record), float(concerned))
            elif effect.enters == control(target) and concerned:
                known = {target: record[target][:, None]}
                added = disturbance_series([one], [record.name], record.t[:, None], known, [control(target)])
                channels[target] = channels.get(target, record[target]) + added[:, 0, 0]
            elif target in record and concerned and effect.kind == "sensor_delay":
                channels[target] = operators.earlier(record.t, record[target], one.values["value"])
            elif target in record and concerned and effect.timed:
                channels[target] = np.where(record.t < one.onsets[record.name], record[target], np.nan)
        return record.with_channels(**channels) if channels else record


def _filled(record: Record, name: str) -> np.ndarray:
    """A reading without gaps; zero where there is none."""
    if name not in record or not np.isfinite(record[name]).any():
        return np.zeros(len(record))
    there = np.isfinite(record[name])
    return np.interp(record.t, record.t[there], record[name][there])
