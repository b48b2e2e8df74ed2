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
from casid.diagnosis.flight.noise import SimulatedRecords, View, view_of
from casid.diagnosis.given.as_given import AsGiven
from casid.diagnosis.systems.plant import Draft, Plant
from casid.errors import InputError
from casid.model.station import control
from casid.model.system import Model
from casid.records.record import Record


def fly_as_given(plant: Plant, held: Sequence[Record], refitted: FlightFit) -> AsGiven:
    """Simulations of the fitted and the held-out records with the nominal values, from fitted initial states."""
    fitted, unseen = (_flown(plant, records, refitted.derivatives) for records in (plant.records, held))
    return AsGiven(mended=(fitted, unseen))


def _flown(plant: Plant, records: Sequence[Record], otherwise: Mapping[str, float]) -> View:
    """A simulation with the nominal values.

    If the model cannot follow the records at all with these, the fit is that with the values `otherwise`, and the
    errors are infinite.
    """
    try:
        return view_of(_of_states(plant.elsewhere({}, records)))
    except InputError:
        view = view_of(_of_states(plant.elsewhere(otherwise, records)))
        lost = np.full_like(view.simulated.output, np.inf)
        channels = {
            name: replace(one, rms=np.inf, whiteness_p=0.0, theil=1.0, R2=-np.inf)
            for name, one in view.channels.items()
        }
        residual = np.where(np.isfinite(view.simulated.residual), lost, np.nan)
        simulated = SimulatedRecords(output=lost, residual=residual)
        return View(fit=replace(view.fit, data_deviance=np.inf), simulated=simulated, channels=channels)


def _of_states(plant: Plant) -> FlightFit:
    flight = plant
    with np.errstate(all="ignore"):
        return fit(flight, plant.known(plant.names), flight.noise(), free="states")


@dataclass(frozen=True, eq=False, kw_only=True)
class Extended:
    """A model with causes in it."""

    base: Model  # the model without them, with fitted values
    attached: tuple[Attached, ...]  # the causes with their values
    terms: Mapping[str, ca.SX]

    @cached_property
    def model(self) -> Model:
        """The extended model: causes in its equations are parameters, a lag of an instrument is a state. A cause of
        some records has an input of its name in brackets, 1 where it is there."""
        draft = Draft(self.base, self.terms)
        base = self.base
        own = [one for one in self.attached if one.effect.symbolic or one.effect.forms.instrument]
        values = {one.name: ca.SX.sym("value") for one in own}
        there = {f"[{one.name}]": ca.SX.sym("there") for one in own if one.effect.symbolic and one.records}
        states: dict[str, tuple[ca.SX, ca.SX]] = {}
        for one in own:
            value = values[one.name]
            target = one.effect.target
            if one.effect.forms.instrument is None:
                assert one.effect.change is not None
                one.effect.change(draft, {"value": value * there.get(f"[{one.name}]", 1.0)})
                continue
            state = ca.SX.sym("lagged")
            true = draft.h[base.outputs.index(target)]
            states[f"lagged[{target}]"] = state, one.effect.forms.instrument(true, state, {"value": value})
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
        lagged = [one.effect.target for one in self.attached if one.effect.forms.instrument]
        read = [_filled(record, name) for name in lagged]
        return np.column_stack([self.base.guess(record), *read])

    def prepared(self, record: Record) -> Record:
        """The record as the extended model takes it: inputs as they act, readings without their delay, none of an
        instrument that is stuck."""
        channels: dict[str, np.ndarray] = {}
        for one in sorted(self.attached, key=lambda one: one.effect.timed):  # an onset is on the clock without delay
            effect = one.effect
            target = one.effect.target
            concerned = one.concerns(record.name)
            if effect.symbolic and one.records:
                channels[f"[{one.name}]"] = np.full(len(record), float(concerned))
            elif effect.enters == control(target) and concerned:
                known = {target: record[target][:, None]}
                added = disturbance_series([one], [record.name], record.t[:, None], known, [control(target)])
                channels[target] = channels.get(target, record[target]) + added[:, 0, 0]
            elif target in record and concerned and effect.forms.undo:
                channels |= effect.forms.undo(record.t, {target: record[target]}, one.values)
            elif target in record and concerned and effect.timed:
                read = channels.get(target, record[target])
                channels[target] = np.where(record.t < one.onsets[record.name], read, np.nan)
        return record.with_channels(**channels) if channels else record


def _filled(record: Record, name: str) -> np.ndarray:
    """A reading without gaps; zero where there is none."""
    if name not in record or not np.isfinite(record[name]).any():
        return np.zeros(len(record))
    there = np.isfinite(record[name])
    return np.interp(record.t, record.t[there], record[name][there])
