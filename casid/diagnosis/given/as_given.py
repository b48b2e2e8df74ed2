"""The file flown as given: simulations of the records by the unmodified file or model."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from casid.diagnosis.flight.evaluation import FlightFit
from casid.diagnosis.flight.fit import fit
from casid.diagnosis.flight.hypothesis import Attached
from casid.diagnosis.flight.noise import SimulatedRecords, View, view_of
from casid.diagnosis.flight.subject import Subject
from casid.errors import InputError
from casid.filtering.initial_state import measured_start
from casid.model.aircraft import Aircraft
from casid.model.effects import effect_of
from casid.model.in_force import sizes_of
from casid.native.processors import side_by_side
from casid.records.record import Record


@dataclass(frozen=True, eq=False, kw_only=True)
class AsGiven:
    """Simulations by the unmodified file of the fitted and the held-out records, with the data corrected; and as they
    were `recorded`, where that differs."""

    mended: tuple[View, View]
    recorded: tuple[View, View] | None = None

    @property
    def fitted(self) -> View:
        """View of the fitted records as they were recorded."""
        return (self.recorded or self.mended)[0]

    @property
    def held(self) -> View:
        """View of the held-out records as they were recorded."""
        return (self.recorded or self.mended)[1]


def fly_system_as_given(
    subject: Subject,
    held: Sequence[Record],
    known: Callable[[Sequence[str]], Sequence[Attached]],
    otherwise: Mapping[str, float],
) -> AsGiven:
    """Simulations of the fitted and the held-out records with the nominal values, from fitted initial states.

    known      effects that are stated of the records of some names
    otherwise  values with which the model follows the records, for nominal ones with which it cannot follow them at
               all: then the fit is that with these, and the errors are infinite
    """

    def flown(records: Sequence[Record]) -> View:
        try:
            return view_of(states(subject.elsewhere({}, records)))
        except InputError:
            return _lost(view_of(states(subject.elsewhere(otherwise, records))))

    def states(there: Subject) -> FlightFit:
        with np.errstate(all="ignore"):
            return _states(there, known(there.names))

    return AsGiven(mended=(flown(subject.records), flown(held)))


def _lost(view: View) -> View:
    """A view with infinite errors."""
    lost = np.full_like(view.simulated.output, np.inf)
    channels = {
        name: replace(one, rms=np.inf, whiteness_p=0.0, theil=1.0, R2=-np.inf) for name, one in view.channels.items()
    }
    simulated = SimulatedRecords(output=lost, residual=np.where(np.isfinite(view.simulated.residual), lost, np.nan))
    return View(fit=replace(view.fit, data_deviance=np.inf), simulated=simulated, channels=channels)


def error_over_noise(views: Sequence[View]) -> float:
    """R.m.s. over channels and simulations of errors in units of the noise; infinite where one departs."""
    found = [one.rms / view.fit.noise.measurement[name] for view in views for name, one in view.channels.items()]
    return float(np.sqrt(np.mean(np.square(found)))) if np.isfinite(found).all() else np.inf


def fly_as_given(flight: Subject, held: Sequence[Record], known: Sequence[Attached]) -> AsGiven:
    """Simulations of the fitted and the held-out records by the unmodified file; `known` are its own effects."""
    both = [flight, flight.elsewhere({}, held)]
    fitted, unseen = side_by_side(lambda one: _flown(one, known), both)
    return AsGiven(mended=(fitted, unseen))


def fly_recorded(
    flight: Subject, recorded: tuple[Sequence[Record], Sequence[Record]], known: Sequence[Attached]
) -> tuple[View, View] | None:
    """The same with the records before they were corrected; None if it cannot be simulated with these."""
    fitted, held = recorded
    try:
        return fly_as_given(flight.elsewhere({}, fitted), held, known).mended
    except InputError:
        return None


def attached_effects(aircraft: Aircraft, names: Sequence[str]) -> list[Attached]:
    """The effects of the aircraft file that act in the records of these names, to be fitted further."""
    found = []
    for value in aircraft.effects:
        effect = effect_of(value)
        onsets = {r: 0.5 * (lo + hi) for r, (lo, hi) in (value.onset_s or {}).items() if r in names}
        records = tuple(r for r in value.records if r in names)
        elsewhere = not onsets if effect.timed else bool(value.records) and not records
        if not effect.stochastic and not elsewhere:
            values = effect.in_words(sizes_of(value, effect))  # a time constant below zero acts as its size does
            found.append(Attached(effect=effect, values=values, onsets=onsets, records=records))
    return found


def _flown(flight: Subject, known: Sequence[Attached]) -> View:
    view = view_of(_states(flight, known), _start(flight, known))
    return replace(view, fit=view.fit.lighter())


def _states(flight: Subject, known: Sequence[Attached]) -> FlightFit:
    return fit(flight, known, flight.noise(), free="states")


def _start(flight: Subject, known: Sequence[Attached]) -> np.ndarray | None:
    """(R, states) initial states: measured ones, and fits to the first seconds for the others; None if those seconds do
    not determine them.
    """
    window = flight.criteria.structure.stretch
    parts = [record.between(record.t[0], record.t[0] + window) for record in flight.records]
    try:
        short = flight.elsewhere({}, parts)
        begun = _states(short, known)
    except InputError:
        return None
    beginning = flight.criteria.numerics.events.step
    return np.stack(
        [
            measured_start(begun.model, record, begun.motion.X[0, r], begun.parameters[r], beginning)
            for r, record in enumerate(short.records)
        ]
    )
