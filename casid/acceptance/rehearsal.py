"""Manoeuvres flown by an aircraft file before they are flown: from level flight, without noise."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from casid.design.level_flight import SURFACES, Limits, experiment_of
from casid.design.manoeuvres import flyable
from casid.errors import EstimationError, InputError
from casid.model.aircraft import Aircraft
from casid.model.dynamics import MOVING, aircraft_model
from casid.model.simulate import simulate
from casid.model.trim import trim
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
    outputs: tuple[str, ...]


def rehearsed(aircraft: Aircraft, manoeuvres: Sequence[Record], axes: str) -> Rehearsal:
    """The aircraft flown through the inputs of manoeuvres, as changes from their first samples, from level flight at
    the [trim] of its file. Raises InputError when it has no trim or diverges."""
    bare = replace(aircraft, effects=())
    model = aircraft_model(bare, axes=axes)
    known = {name: aircraft.trim[name] for name in ("V", "altitude", "rho") if name in aircraft.trim}
    if "V" not in known or len(known) < 2:
        raise InputError(f"'{aircraft.name}': [trim] needs V, and altitude or rho, to be flown; add them to the file")
    known.pop("altitude" if "rho" in known else "rho", None)
    at = trim(bare, V=known["V"], altitude=known.get("altitude"), rho=known.get("rho"))
    level = dict(zip(MOVING["full"], at.state.tolist(), strict=True)) | at.inputs
    records = []
    for one in manoeuvres:
        inputs = {}
        for name in model.inputs:
            moved = name in one and name in (*SURFACES["full"], "thrust")
            inputs[name] = level[name] + (one[name] - one[name][0] if moved else np.zeros(len(one)))
        hold = one.hold if isinstance(one.hold, str) else {n: how for n, how in one.hold.items() if n in inputs}
        flown = Record(name=one.name, t=one.t, channels=inputs, hold=hold, source="rehearsed")
        records.append(simulate(model, flown, np.array([level[name] for name in model.states])).as_record())
    found = {name: level[name] for name in ("theta", "delta_e", "thrust", "rho")} | {"V": at.V, "alpha": at.alpha}
    file = replace(bare, trim={**aircraft.trim, **found})
    return Rehearsal(aircraft=file, axes=axes, records=tuple(records), outputs=model.outputs)


def further_manoeuvres(flown: Rehearsal) -> Iterator[tuple[str, Rehearsal]]:
    """In words, and the rehearsal with it: a 3-2-1-1, a doublet and a sweep on each surface, within ordinary limits."""
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
            try:
                command = Record(
                    name="further",
                    t=experiment.t,
                    channels={s: size * one.moves * (s == one.surface) for s in SURFACES["full"]},
                    hold="linear",
                    source="designed",
                )
                (more,) = rehearsed(flown.aircraft, [command], flown.axes).records
            except (InputError, EstimationError):
                continue
            words = f"{one.surface}: {one.words}, {math.degrees(size):.2g} deg"
            yield words, replace(flown, records=(*flown.records, more))
