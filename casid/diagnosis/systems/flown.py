"""A model flown open loop on records that no fit has seen."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from casid.diagnosis.flight.evaluation import FlightFit
from casid.diagnosis.flight.fit import fit
from casid.diagnosis.flight.statistics import free_simulation
from casid.diagnosis.systems.plant import Plant, as_flight
from casid.errors import InputError
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
