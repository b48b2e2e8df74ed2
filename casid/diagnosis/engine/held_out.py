"""Test of the causes on held-out records.

Only initial states, and onsets of events, are estimated on the held-out records. Derivatives and effects keep the
uncertainty that the fitted records leave (`predicted`). By the chain rule of probability, ln p(held-out | fitted) adds
to the log likelihood of the fitted records.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy.linalg import block_diag

from casid.diagnosis import comparisons as ask
from casid.diagnosis.comparisons import Gate
from casid.diagnosis.engine.baseline import Baseline
from casid.diagnosis.engine.search import State
from casid.diagnosis.engine.trial import Trial
from casid.diagnosis.evidence.evidence import Evidence, is_sure, weigh
from casid.diagnosis.evidence.fingerprints import fingerprints, onset_grid
from casid.diagnosis.evidence.onsets import at_peak
from casid.diagnosis.evidence.screening import Screen
from casid.diagnosis.flight.evaluation import FlightFit, scaled_inverse
from casid.diagnosis.flight.fit import all_free, fit, without
from casid.diagnosis.flight.hypothesis import Attached
from casid.diagnosis.flight.noise import in_colour
from casid.diagnosis.flight.subject import Subject
from casid.diagnosis.gates import required_gain
from casid.diagnosis.kinematics.kinematics import forceless_noise, without_aerodynamics
from casid.diagnosis.kinematics.turbulence import gusts
from casid.errors import InputError
from casid.model.effect import with_grid
from casid.native.processors import side_by_side
from casid.records.record import Record


def predicted_on(records: Sequence[Record], known: Evidence) -> Predicted:
    """The predictive density of `records` given the fitted ones (see `judge_on`, `predicted`)."""
    return predicted(judge_on(records, known.fit), known)


def judge_on(records: Sequence[Record], fitted: FlightFit) -> FlightFit:
    """The fitted model on other records, with derivatives and effects fixed.

    If the noise was estimated with the model, it is estimated again on these records. An effect that exists only in
    some of the fitted records is used if it helps, and a recurring event is placed where it helps most.
    """
    held = fitted.flight.elsewhere(fitted.derivatives, records)
    steady = [_everywhere(a) for a in fitted.attached if not a.effect.timed]
    base = in_colour(fit(held, steady, fitted.held, free="states", extent="settled"), free="states")
    for one in fitted.attached:
        if one.records:
            without = _states(base, [a for a in base.attached if a.name != one.name])
            base = min(base, without, key=lambda f: f.deviance)
    recurring = [a for a in fitted.attached if a.effect.event.recurring]
    for one in (*recurring, *recurring[:-1]):  # a second pass, beside those added after the first
        base = _recurred(base, one)
    return base


def with_events(held: FlightFit, fitted: FlightFit) -> FlightFit:
    """The fit of held-out records with non-recurring events as well, if they happen there too."""
    for one in fitted.attached:
        if one.effect.timed and not one.effect.event.recurring:
            held = _recurred(held, one)
    return held


def _recurred(base: FlightFit, one: Attached) -> FlightFit:
    """The fit with an event at its best onset, or without it, whichever has the smaller deviance; without it where the
    model diverges with it."""
    others = [a for a in base.attached if a.name != one.name]
    without = base if len(others) == len(base.attached) else _states(base, others)
    found = [base, without]
    if onsets := _onsets(without, one):
        moves = base.criteria.numerics.naming.few
        with suppress(InputError, np.linalg.LinAlgError):
            moved = _states(without, [*others, replace(one, onsets=onsets)])
            found.append(at_peak(weigh(moved, discrepancy=False), moves, free="states")[0].fit)
    return min(found, key=lambda f: f.deviance)


def _states(base: FlightFit, attached: Sequence[Attached]) -> FlightFit:
    """Fit only the initial states with these effects."""
    return fit(base.flight, attached, base.noise, base, free="states", extent="settled")


def _everywhere(one: Attached) -> Attached:
    """The effect acting in all records."""
    return replace(one, records=())


def _onsets(base: FlightFit, one: Attached) -> dict[str, float]:
    """Best onset of an event of known size in each record; records in which it does not help are left out."""
    judge = Screen(weigh(base, discrepancy=False))
    found = {}
    size = one.values["value"]
    further = {k: v for k, v in one.values.items() if k != "value"}
    effect = with_grid(one.effect, {**further, "value": size})
    step = judge.criteria.numerics.events.gust_step
    length = further.get("length", np.inf)
    prints = fingerprints(judge.evidence, [effect], onset_grid(judge.evidence, step, length))
    for r, record in enumerate(base.flight.records):
        drops = [judge.drop(print_, r) for print_ in prints]  # empty if the record is too short for an event
        if max(drops, default=0.0) > 2.0 * np.log(max(len(prints), 1)):
            found[record.name] = float(record.t[0] + (prints[int(np.argmax(drops))].onset or 0.0))
    return found


def kinematic_gain(
    flight: Subject,
    held: Sequence[Record],
    before: FlightFit,
    after: FlightFit,
    moving: Mapping[str, tuple[float, float]],
) -> float:
    """Increase of the log likelihood per held-out sample due to instrument faults, with forces left free.

    This test does not depend on the aerodynamics, so errors of the aerodynamics in the held-out records cannot reject
    the fault.

    before, after  the fits without and with the fault
    moving         port -> r.m.s. and time constant [s] of each process of turbulence.
    """
    there = without_aerodynamics(flight.elsewhere({}, held))
    noise = forceless_noise(there, moving)
    found = []
    for step in (before, after):
        faults = [_everywhere(a) for a in step.attached if a.effect.of_an_instrument]
        found.append(fit(there, faults, noise, free="states", extent="settled"))
    return 0.5 * (found[0].data_deviance - found[1].data_deviance) / found[1].readings


@dataclass(frozen=True, eq=False, kw_only=True)
class Kept:
    """The model with those causes that the held-out records support."""

    evidence: Evidence  # evidence of this model on the fitted records
    held_fit: FlightFit  # fit of this model on the held-out records
    held_calm: FlightFit  # fit of the re-estimated model on the held-out records
    structure: list[Attached]  # terms added before the search that are significant
    structure_gain: float | None  # log likelihood per held-out sample that all structure terms add; None without any
    air_gain: float | None  # the same for turbulence; None in calm air
    # the same for each cause by name; None for an event that the held-out records do not repeat, and where the model
    # diverges there with the cause or without it
    gains: Mapping[str, float | None]
    gates: Mapping[str, Gate]  # gate of each cause on the held-out records, by name

    @property
    def fit(self) -> FlightFit:
        return self.evidence.fit

    def has_all(self, state: State) -> bool:
        """Return True if the model contains every cause of the final model of the search."""
        return {one.leader.effect.key for one in state.standing} <= {one.effect.key for one in self.fit.attached}

    def with_effects(self, nuisance: Sequence[Attached]) -> FlightFit:
        """The fit with further effects."""
        return fit(self.fit.flight, [*self.fit.attached, *nuisance], self.fit.noise, self.fit)


def keep(held: Sequence[Record], state: State) -> Kept:
    """Remove the causes that the held-out records do not support.

    The cause with the largest loss is removed first and the others are tested again, because it may be the reason for
    their loss. A model that diverges on a held-out record has lost against all others. Structure terms that are not
    significant are removed at the end.

    raises  InputError if the re-estimated file diverges there
    """
    begun = state.baseline
    final = state.fit
    steps = [begun.calm, begun.structured, begun.start]
    judged = partial(_judged, held, state)
    models = {_key(one): one for one in (*steps, final)}
    known = dict(zip(models, side_by_side(judged, list(models.values())), strict=True))
    calm, structured, start, there = (known[_key(one)][1] for one in (*steps, final))
    if not calm.flown:
        raise InputError(calm.why)
    causes = {one.leader.candidate.name: one.leader for one in state.standing}
    gates: dict[str, Gate] = {}
    gains: dict[str, float | None] = {}
    if not there.flown:
        final, evidence, there = _flown(final, list(causes), steps, judged)
        known[_key(final)] = evidence, there
        gates = {name: ask.SIMULATED.failed() for name in causes if name not in _names_of(final)}
        gains = dict.fromkeys(gates)
        causes = {name: one for name, one in causes.items() if name not in gates}
    while causes:
        others = {name: _key(final, but={name}) for name in causes}
        new = {key: frozenset({name}) for name, key in others.items() if key not in known}
        left_out = side_by_side(partial(judged, final), list(new.values()))
        known |= dict(zip(new, left_out, strict=True))
        both = {name: (known[others[name]], known[_key(final)]) for name in causes}
        tested = {name: _gain_of(one, *both[name], held, begun) for name, one in causes.items()}
        gains |= {name: gain if gain is None or np.isfinite(gain) else None for name, gain in tested.items()}
        gates |= {name: _borne_out(causes[name], gain, there, state) for name, gain in tested.items()}
        worst = min(causes, key=lambda name: gates[name].value)
        if gates[worst].passed:
            break
        final = known[others[worst]][0].fit
        there = known[others[worst]][1]
        del causes[worst]
    evidence = known[_key(final)][0]
    structure = [one for one in (*begun.structure, *_put_in_later(begun, final)) if one.name in _names_of(final)]
    unsure = {one.name for one in structure if not is_sure(evidence, one.name)}
    held_fit = there.fit
    if unsure:  # a term that these records do not determine can take any size
        final = without(final, unsure)
        evidence = weigh(final)
        held_fit = judge_on(held, final)
    return Kept(
        evidence=evidence,
        held_fit=with_events(held_fit, final),
        held_calm=calm.fit,
        structure=[one for one in structure if one.name not in unsure],
        structure_gain=_per_sample(calm, structured) if begun.structure else None,
        air_gain=_per_sample(structured, start) if begun.turbulence.named else None,
        gains=gains,
        gates=gates,
    )


_Key = tuple[frozenset[str], bool]  # names of the effects of a model, and whether its air moves
_Judged = tuple[Evidence, "Predicted"]


def _names_of(fitted: FlightFit) -> frozenset[str]:
    return frozenset(one.name for one in fitted.attached)


def _key(fitted: FlightFit, but: Collection[str] = ()) -> _Key:
    return _names_of(fitted) - set(but), bool(fitted.noise.coloured)


def _flown(
    final: FlightFit, causes: Sequence[str], steps: Sequence[FlightFit], judged: Callable[..., _Judged]
) -> tuple[FlightFit, Evidence, Predicted]:
    """The model with those causes of `final`, in the order in which they were named, with which it can be flown on the
    held-out records; without one, the last of the `steps` before the causes that can be flown there.
    """
    out = frozenset(causes)
    found = None
    for name in causes:
        evidence, there = judged(final, out - {name})
        if there.flown:
            out -= {name}
            found = evidence.fit, evidence, there
    if found is not None:
        return found
    tried = ((step, *judged(step)) for step in reversed(steps))
    return next(one for one in tried if one[-1].flown)


def _judged(held: Sequence[Record], state: State, fitted: FlightFit, but: frozenset[str] = frozenset()) -> _Judged:
    """The evidence of a model, or of a model without some effects, and its predictive density of the held-out
    records."""
    is_final = fitted is state.fit and not but
    evidence = state.evidence if is_final else weigh(without(fitted, but) if but else fitted)
    try:
        on_held = predicted_on(held, evidence)
    except (InputError, np.linalg.LinAlgError) as error:
        on_held = Predicted(fit=evidence.fit, deviance=np.inf, why=str(error))
    return evidence, on_held


def _per_sample(before: Predicted, after: Predicted) -> float:
    """Log likelihood per held-out sample that one model gains over another."""
    return 0.5 * (before.deviance - after.deviance) / after.fit.readings


def _gain_of(
    cause: Trial,
    before: tuple[Evidence, Predicted],
    after: tuple[Evidence, Predicted],
    held: Sequence[Record],
    begun: Baseline,
) -> float | None:
    """Log likelihood per held-out sample that a cause adds to a model; None for an event that is not repeated there.

    An instrument fault that the kinematics confirm and that loses is judged by the kinematics of the held-out records,
    which contain no aerodynamics.
    """
    (model, without_it), (extended, with_it) = before, after
    if cause.candidate.name not in {one.name for one in with_it.fit.attached}:
        return None
    gain = _per_sample(without_it, with_it)
    if gain < 0.0 and cause.confirmed and cause.effect.of_an_instrument:
        air = begun.turbulence
        flight = begun.flight
        moving = gusts(flight, air.sigma, length=air.length) if air.named else {}
        return kinematic_gain(flight, held, model.fit, extended.fit, moving)
    return gain


def _borne_out(cause: Trial, gain: float | None, there: Predicted, state: State) -> Gate:
    """The gate on a cause with the held-out records.

    Its statistic on the held-out records, plus what exceeds the required statistic on the fitted ones, must not be
    negative.
    """
    spare = cause.gain.net - required_gain(cause.effect, state.criteria)
    return ask.BORNE_OUT.of(2.0 * there.fit.readings * (gain or 0.0) + spare, 0.0)


def _put_in_later(begun: Baseline, final: FlightFit) -> list[Attached]:
    """Nuisance errors of instruments that were added during the search."""
    before = {one.name for one in begun.structure}
    return [one for one in final.attached if one.nuisance and one.name not in before]


@dataclass(frozen=True, eq=False, kw_only=True)
class Predicted:
    """A fitted model on held-out records."""

    # fit of the held-out records, in which only the motion is estimated; of the fitted records if it diverges there
    fit: FlightFit
    deviance: float  # -2 ln p(held-out readings | fitted readings), up to a constant of the data
    why: str = ""  # why it cannot be flown there

    @property
    def flown(self) -> bool:
        """Return True if the model can be flown there at all."""
        return bool(np.isfinite(self.deviance))


def predicted(held: FlightFit, known: Evidence) -> Predicted:
    """The posterior predictive density of held-out records.

    The model is linearised about its values. Values and model discrepancy have the covariance that the fitted records
    leave. With fixed values, a correct cause could lose because the fitted records determine poorly the derivatives
    that matter on the held-out ones: an aileron manoeuvre does not determine the rudder derivatives.
    """
    there = weigh(all_free(held))
    mean, information = _expected(known, there)
    gram, slope = _data(there)
    posterior = gram + information
    pull = slope + information @ mean
    moved = float(mean @ information @ mean) - float(pull @ scaled_inverse(posterior) @ pull)
    informed = np.flatnonzero(posterior.diagonal() > 0.0)  # an end beyond all records has no information, nor a volume
    before, after = (np.linalg.slogdet(one[np.ix_(informed, informed)])[1] for one in (information, posterior))
    return Predicted(fit=held, deviance=there.fit.data_deviance + moved + float(after - before))


def _data(there: Evidence) -> tuple[np.ndarray, np.ndarray]:
    """Normal equations (matrix, right-hand side) of the held-out readings alone, without priors."""
    gram = there.sums.gram.copy()
    slope = there.sums.slope.copy()
    k = len(there.fit.slots)
    gram[range(k), range(k)] -= there.fit.prior_weight
    slope[:k] += there.fit.prior_pull
    return gram, slope


def _expected(known: Evidence, there: Evidence) -> tuple[np.ndarray, np.ndarray]:
    """Distribution of the held-out parameters and model discrepancy according to the fitted records.

    mean         expected values
    information  inverse of the covariance. Parameters that the fitted records do not contain have their prior.
    """
    names = _names(there)
    before = _names(known)
    both = [name for name in names if name in before]
    at: np.ndarray = np.array([names.index(name) for name in both], dtype=int)
    of: np.ndarray = np.array([before.index(name) for name in both], dtype=int)
    unit = (
        np.r_[np.ones(len(known.fit.slots)), known.factors][of]
        / np.r_[np.ones(len(there.fit.slots)), there.factors][at]
    )
    scale = np.array([known.scales.get(c, 1.0) for c, _ in there.terms])
    prior = np.asarray(block_diag(np.diag(there.fit.prior_weight), there.small_information / scale[:, None] / scale))
    mean = np.zeros(len(names))
    mean[at] = known.newton[of] * unit
    information = np.zeros((len(names), len(names)))
    others = np.array([i for i, name in enumerate(names) if name not in before], dtype=int)
    information[others[:, None], others] = prior[others[:, None], others]
    information[at[:, None], at] = scaled_inverse(known.covariance[of[:, None], of] * unit[:, None] * unit)
    return mean, information


def _names(evidence: Evidence) -> list[object]:
    return [*(slot.name for slot in evidence.fit.slots), *evidence.terms]
