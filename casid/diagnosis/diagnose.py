"""The main job: what does the simulation get wrong, which cause is it, and what does the extended model gain?"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np

from casid.diagnosis import kinematics
from casid.diagnosis.events import at_peak
from casid.diagnosis.evidence import Evidence, weigh
from casid.diagnosis.fit import Fit, fit
from casid.diagnosis.flight import Flight, prepare
from casid.diagnosis.held_out import judge_on, split
from casid.diagnosis.hypothesis import Attached
from casid.diagnosis.kinematics import Turbulence
from casid.diagnosis.missing_input import READING, drifts, missing_inputs, missing_oscillation
from casid.diagnosis.naming import LEFT_BY_A_CAUSE, LEFT_BY_AN_EVENT, name_causes
from casid.diagnosis.noise_level import with_noise_level
from casid.diagnosis.result import Diagnosis, View
from casid.diagnosis.screening import Candidate, screen
from casid.diagnosis.size import plausible
from casid.diagnosis.statistics import channel_fits, free_simulation
from casid.diagnosis.structure import demanded_structure
from casid.diagnosis.trials import CONFIRMED
from casid.diagnosis.verdict import (
    causes_of,
    extended_aircraft,
    smallest_detectable,
    still_missing,
    too_small,
    verdict_of,
)  # fmt: skip
from casid.model.aircraft import Aircraft
from casid.model.effect import Effect
from casid.model.effects import catalogue, effect_of
from casid.records.record import Record

_REPAIRS = 3
# a gust model is rough: a cause in turbulence must gain more than this part of what the turbulence does
_OF_TURBULENCE = 0.02
_OF_THE_AIR = tuple(READING + channel for channel in ("V", "alpha", "beta"))
_OF_ONE_READING = 1.5  # times what turbulence gains, and it is none
_RIVAL = 0.3  # of what turbulence gains, for a fault; of what faults gain alone, in moving air


class Stages:
    """Wall time per stage, and a word to the user at the beginning of each."""

    def __init__(self, report: Callable[[str], None]) -> None:
        self._report = report
        self._name, self._since = "", time.perf_counter()
        self.seconds: dict[str, float] = {}

    def begin(self, name: str) -> None:
        self.end()
        self._name, self._since = name, time.perf_counter()
        self._report(name)

    def end(self) -> None:
        if self._name:
            self.seconds[self._name] = self.seconds.get(self._name, 0.0) + time.perf_counter() - self._since
        self._name = ""


def diagnose(
    aircraft: Aircraft,
    records: Sequence[Record],
    hold_out: Sequence[Record] = (),
    report: Callable[[str], None] = lambda stage: None,
) -> Diagnosis:
    """Diagnose an aircraft file on flight records.

    hold_out  records that are never fitted; when none is given one record, or the last third of a single one, is held
    back. report  is called with the name of every stage. Raises InputError for records that cannot feed the model.
    """
    stages = Stages(report)
    stages.begin("reading the records")
    fitted, held = split(records, hold_out)
    flight = prepare(aircraft, fitted)
    known = attached_effects(flight)
    flight = with_noise_level(flight, known)
    stages.begin("kinematics")
    kinematic, instruments, turbulence = _kinematics(flight, known)
    stages.begin("baseline fit")
    calm = fit(flight, known, flight.noise())
    structure = demanded_structure(calm)
    structured = fit(flight, [*known, *structure], flight.noise(), calm) if structure else calm
    coloured = turbulence.named
    start = structured
    if coloured:
        start = kinematics.rotation_of_air(flight, turbulence, structured)
    baseline = weigh(start)
    stages.begin("naming")
    least = _OF_TURBULENCE * turbulence.gain if coloured else 0.0
    naming = name_causes(baseline, catalogue(flight.aircraft, flight.outputs), kinematic, least, report)
    stages.begin("held-out records")
    steps = [structured, *([start] if coloured else []), *(r.winner for r in naming.rounds if r.named)]
    on_held = [judge_on(flight, held, step) for step in steps]
    held_calm = judge_on(flight, held, calm) if structure else on_held[0]
    gains = _held_gains(on_held)
    final, held_final = _best_on_held(flight, held, steps, on_held, gains)
    stages.begin("missing inputs")
    same = final is naming.evidence.fit
    judged = naming.evidence if same else weigh(final)
    left = naming.missing if same else missing_inputs(judged)
    exact = missing_inputs(weigh(final, discrepancy=False))
    stages.begin("verdict")
    structure_gain = _held_gains([held_calm, on_held[0]])[0]
    of_rounds = gains if coloured else [None, *gains]
    causes, minor = causes_of(naming, judged, turbulence, of_rounds, structure, structure_gain)
    keys = {one.effect.key for one in structure}
    of_structure = any((c.kind, c.target, c.term) in keys for c in causes)
    bare = calm if of_structure and not coloured else start  # without any cause
    first = exact if final is bare else missing_inputs(weigh(bare, discrepancy=False))
    rough = sum((LEFT_BY_AN_EVENT if one.onset_s else LEFT_BY_A_CAUSE) * one.statistic for one in causes)
    if coloured:  # slow wind is part of turbulence, whatever its spectrum
        left = [m for m in left if m.station not in _OF_THE_AIR]
    unexplained = still_missing(final, [*left, *missing_oscillation(judged)], max(least, rough))
    small = too_small(naming, (*causes, *minor), unexplained)
    if small and (same or not unexplained):
        minor, unexplained = (*minor, *small), []
    verdict, sentence = verdict_of(causes, minor, unexplained, final)
    candidates = naming.rounds[0].candidates
    views = [_view(one) for one in (calm, final, held_calm, held_final)]
    extended = extended_aircraft(flight.aircraft, final, causes, structure)
    stages.end()
    return Diagnosis(
        verdict=verdict, sentence=sentence, aircraft=aircraft, extended_aircraft=extended, causes=causes, minor=minor,
        ranking=candidates[:40], rounds=naming.rounds, baseline=views[0], extended=views[1],
        held_out_baseline=views[2], held_out_extended=views[3], missing_before=tuple(first),
        missing_after=tuple(exact), unexplained=tuple(unexplained), kinematic=tuple(instruments), turbulence=turbulence,
        detectable=smallest_detectable(candidates), seconds=stages.seconds,
    )  # fmt: skip


def attached_effects(flight: Flight) -> list[Attached]:
    """The effects that the aircraft file already has, to be fitted further."""
    found = []
    for value in flight.aircraft.effects:
        effect = effect_of(value)
        if effect.stochastic:
            continue
        onsets = {r: 0.5 * (lo + hi) for r, (lo, hi) in (value.onset_s or {}).items() if r in flight.names}
        found.append(
            Attached(
                effect=effect, values={"value": value.value} | dict(value.parameters), onsets=onsets,
                records=tuple(r for r in value.records if r in flight.names),
            )
        )  # fmt: skip
    return found


def _kinematics(flight: Flight, known: Sequence[Attached]) -> tuple[Evidence | None, list[Candidate], Turbulence]:
    """Evidence with forces free, in the air as it moves; its ranking of instrument and air causes; and turbulence."""
    none = Turbulence(sigma=0.0, std=0.0, gain=0.0, records=flight.names)
    if not kinematics.available(flight):
        return None, [], none
    of_the_file = [one for one in known if one.effect.kinematic]
    calm = kinematics.reconstruct(flight, of_the_file)
    evidence = weigh(calm, discrepancy=False)
    taken = {one.effect.key for one in of_the_file}
    effects = [e for e in catalogue(flight.aircraft, flight.outputs) if e.kinematic and e.key not in taken]
    ranked = screen(evidence, effects)
    turbulent = kinematics.turbulence(flight, calm)
    if turbulent.named and drifts(evidence)[0].gain > _OF_ONE_READING * turbulent.gain:
        return evidence, ranked, none  # one drifting instrument tells more than all moving air
    turbulent = _beside_faults(flight, turbulent, calm, effects, ranked)
    if not turbulent.named:
        return evidence, ranked, turbulent
    moving = kinematics.gusts(flight, turbulent.sigma, length=turbulent.length)
    evidence = weigh(kinematics.reconstruct(flight, of_the_file, moving, calm), discrepancy=False)
    return evidence, screen(evidence, effects), turbulent


def _beside_faults(
    flight: Flight, turbulent: Turbulence, calm: Fit, effects: Sequence[Effect], ranked: Sequence[Candidate]
) -> Turbulence:
    """Turbulence beside what looks like it until it is in the model: instrument faults, discrete gusts, a shear.

    Moving air imitates any fault, and faults may imitate much of moving air. They are faults when together they leave
    no turbulence, or when they explain much in moving air too.
    """
    faulty, left = calm, turbulent.gain
    moving = kinematics.gusts(flight, turbulent.sigma, length=turbulent.length)
    both = calm.deviance - turbulent.gain
    for _ in range(_REPAIRS if turbulent.named else 0):
        ranked = [one for one in ranked if plausible(one.attached)]
        if not ranked or ranked[0].net < _RIVAL * left:
            break
        other = kinematics.reconstruct(flight, [*faulty.attached, ranked[0].attached], start=faulty)
        if ranked[0].attached.effect.timed:
            other, _ = at_peak(other, free="effects")
        if faulty.deviance - other.deviance < CONFIRMED * ranked[0].net:
            break  # it does not keep what it promised: turbulence looks like an instrument fault too
        faulty, both = other, kinematics.reconstruct(flight, other.attached, moving, other).deviance
        left = faulty.deviance - both
        taken = {a.effect.key for a in faulty.attached}
        ranked = screen(weigh(faulty, discrepancy=False), [e for e in effects if e.key not in taken])
    if faulty is calm:
        return turbulent
    beside = kinematics.turbulence(flight, faulty)
    alone, in_moving_air = calm.deviance - faulty.deviance, calm.deviance - turbulent.gain - both
    return turbulent if beside.named and in_moving_air < _RIVAL * alone else beside


def _view(fitted: Fit) -> View:
    simulated = free_simulation(fitted)
    return View(fit=fitted, simulated=simulated, channels=channel_fits(fitted, simulated))


def steps_to_keep(gains: Sequence[float | None]) -> int:
    """Number of first steps whose gains (None: not known) add up to the most, the largest of equals."""
    sums = np.cumsum([0.0, *(gain or 0.0 for gain in gains)])
    return int(len(gains) - np.argmax(sums[::-1]))


def _best_on_held(
    flight: Flight, held: Sequence[Record], steps: Sequence[Fit], on_held: Sequence[Fit], gains: Sequence[float | None]
) -> tuple[Fit, Fit]:
    """The best model on the held-out records, the largest of equals, and its fit there: the first steps, without those
    of them that lost there and are still no help beside the later ones."""
    kept = steps_to_keep(gains)
    final, held_final = steps[kept], on_held[kept]
    for before, after, gain in zip(steps[:kept], steps[1 : kept + 1], gains, strict=False):
        new = {a.name for a in after.attached} - {a.name for a in before.attached}
        if gain is None or gain >= 0.0 or not new:
            continue
        without = fit(flight, [a for a in final.attached if a.name not in new], final.noise, final)
        held_without = judge_on(flight, held, without)
        if held_without.data_deviance <= held_final.data_deviance:
            final, held_final = without, held_without
    return final, held_final


def _held_gains(on_held: Sequence[Fit]) -> list[float | None]:
    """Log likelihood per sample that each step adds; None for an event that the held-out records do not repeat."""
    gains: list[float | None] = []
    for before, after in pairwise(on_held):
        new = {a.name for a in after.attached} - {a.name for a in before.attached}
        gain = 0.5 * (before.data_deviance - after.data_deviance) / int(after.linear.seen.sum())
        gains.append(gain if new or after.noise.coloured != before.noise.coloured else None)
    return gains
