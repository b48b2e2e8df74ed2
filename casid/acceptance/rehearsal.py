"""Manoeuvres flown by an aircraft file before they are flown: from level flight, without noise."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from casid.design.input_shapes import flyable
from casid.design.level_flight import SURFACES, Limits, experiment_of, level_flight, level_values
from casid.errors import EstimationError, InputError
from casid.model.aircraft import Aircraft
from casid.model.dynamics import aircraft_model
from casid.model.simulate import simulate
from casid.model.system import Model
from casid.records.record import Record

# what further manoeuvres may not exceed, as changes from trim: ordinary flight-test limits, those of `casid design`
_LIMITS = Limits(
    surfaces=dict.fromkeys(SURFACES["full"], math.radians(3.0)),
    channels={name: math.radians(3.0) for name in ("alpha", "beta")} | {name: 0.5 * 9.80665 for name in ("az", "ay")},
    duration=10.0,
)
_SHAPES = ("3-2-1-1 with a shortest pulse of 0.40 s", "doublet with pulses of 0.80 s", "sweep")


@dataclass(frozen=True, eq=False, kw_only=True)
class Rehearsal:
    """Records of an aircraft file in the air, with all `outputs` that its axes have."""

    aircraft: Aircraft
    axes: str
    records: tuple[Record, ...]
    model: Model
    level: Mapping[str, float]  # states and inputs of level flight

    @property
    def outputs(self) -> tuple[str, ...]:
        return self.model.outputs

    def flown(self, manoeuvre: Record) -> Record:
        """The aircraft flown through the inputs of a manoeuvre, as changes from their first samples."""
        inputs = {}
        for name in self.model.inputs:
            moved = name in manoeuvre and name in (*SURFACES["full"], "thrust")
            change = manoeuvre[name] - manoeuvre[name][0] if moved else np.zeros(len(manoeuvre))
            inputs[name] = self.level[name] + change
        hold = manoeuvre.hold
        hold = hold if isinstance(hold, str) else {n: how for n, how in hold.items() if n in inputs}
        record = Record(name=manoeuvre.name, t=manoeuvre.t, channels=inputs, hold=hold, source="rehearsed")
        start = np.array([self.level[name] for name in self.model.states])
        return simulate(self.model, record, start).as_record()


def rehearsed(aircraft: Aircraft, manoeuvres: Sequence[Record], axes: str) -> Rehearsal:
    """The aircraft flown through manoeuvres from level flight at the [trim] of its file. Raises InputError when it has
    no trim or diverges."""
    bare = replace(aircraft, effects=())
    at = level_flight(bare, "to be flown")
    level = level_values(at)
    found = {name: level[name] for name in ("theta", "delta_e", "thrust", "rho")} | {"V": at.V, "alpha": at.alpha}
    file = replace(bare, trim={**aircraft.trim, **found})
    empty = Rehearsal(aircraft=file, axes=axes, records=(), model=aircraft_model(bare, axes=axes), level=level)
    return replace(empty, records=tuple(map(empty.flown, manoeuvres)))


def further_manoeuvres(flown: Rehearsal) -> list[Record]:
    """A 3-2-1-1, a doublet and a sweep on each surface, within ordinary limits, flown and named in words."""
    found = []
    planes = ("longitudinal", "lateral") if flown.axes == "full" else (flown.axes,)
    for plane in planes:
        experiment = experiment_of(flown.aircraft, plane, _LIMITS)  # pyright: ignore[reportArgumentType]
        for one in flyable(experiment):
            if not one.words.startswith(_SHAPES):
                continue
            size = experiment.surfaces[one.surface]
            for _ in range(4):  # the response is nearly linear: the limits are met by proportion
                moved = experiment.record({one.surface: size * one.moves}, "further")
                used = max(
                    np.abs(moved[name] - moved[name][0]).max() / limit for name, limit in experiment.limits.items()
                )
                if used <= 1.0:
                    break
                size *= 0.95 / used
            command = Record(
                name=f"{one.surface}: {one.words}, {math.degrees(size):.2g} deg",
                t=experiment.t,
                channels={s: size * one.moves * (s == one.surface) for s in SURFACES["full"]},
                hold="linear",
                source="designed",
            )
            with suppress(InputError, EstimationError):
                found.append(flown.flown(command))
    return found
