"""Simulations of the model as given, and the model with the named causes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import casadi as ca
import numpy as np

from casid.diagnosis.flight.evaluation import FlightFit
from casid.diagnosis.flight.fit import fit
from casid.diagnosis.flight.hypothesis import Attached
from casid.diagnosis.flight.noise import SimulatedRecords, View, view_of
from casid.diagnosis.given.as_given import AsGiven
from casid.diagnosis.systems.plant import Plant
from casid.errors import InputError
from casid.model.effect_value import EffectValue
from casid.model.system import Model
from casid.model.with_effects import with_effects
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


def extended_model(base: Model, attached: Sequence[Attached], terms: Mapping[str, ca.SX]) -> Model:
    """The model with causes in force: their sizes are parameters of it. `terms` are expressions by name."""
    return with_effects(base, [_value(one) for one in attached], terms)


def _value(one: Attached) -> EffectValue:
    """A cause as an entry that a model takes."""
    effect = one.effect
    sizes = effect.in_words(one.values)
    return EffectValue(
        kind=effect.kind,
        target=effect.target,
        term=effect.term,
        value=sizes.pop("value"),
        records=one.records,
        onset_s={record: (at, at) for record, at in one.onsets.items()} or None,
        parameters=sizes,
    )
