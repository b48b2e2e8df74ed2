"""From naming to a verdict: causes in words, what is minor, what stays unexplained, and the extended aircraft file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from casid.diagnosis.cause import Cause
from casid.diagnosis.decision import Gate, all_passed, at_least, at_most
from casid.diagnosis.evidence.coefficients import unlike_derivatives, variation
from casid.diagnosis.evidence.evidence import Evidence, deviation, sure
from casid.diagnosis.evidence.missing_input import MissingInput, missing_oscillation
from casid.diagnosis.flight.evaluation import FlightFit
from casid.diagnosis.flight.hypothesis import Attached
from casid.diagnosis.judging.kept import Kept
from casid.diagnosis.kinematics.kinematics import Turbulence
from casid.diagnosis.naming.comparing import sine
from casid.diagnosis.naming.events import Intervals
from casid.diagnosis.naming.explaining import mostly_gone
from casid.diagnosis.naming.naming import Naming
from casid.diagnosis.naming.round import Trial
from casid.diagnosis.naming.size import meaningful_share, missing_share, plausible, plausible_size
from casid.diagnosis.naming.structure import is_induced_drag, is_usual
from casid.diagnosis.naming.trials import clear_gain, matters, required_gain
from casid.model import station
from casid.model.aircraft import Aircraft
from casid.model.causes import aero_term, unsteady_aero
from casid.model.causes import turbulence as turbulence_effect
from casid.model.terms import parse_term
from casid.model.vocabulary import effect_sentence

ADEQUATE = "The model is adequate: no cause of a size that matters shows in these records."
_LASTING = ("length", "duration")  # values that say how long an event takes
_OF_THE_AIR = tuple(station.reading(channel) for channel in ("V", "alpha", "beta"))


def causes_of(
    naming: Naming, kept: Kept, turbulence: Turbulence, required: float, left: Sequence[MissingInput]
) -> tuple[tuple[Cause, ...], tuple[Cause, ...]]:
    """(causes, minor), strongest first.

    kept      the final fit. What is not in it lost on the held-out records, is not confirmed and minor. So is a cause
              that is not sure, not needed or not large enough any more beside the others. Terms that were put in
              beforehand, which are expected of any aircraft, are minor unless they pass `_expected`.
    required  gain that such a term must exceed where the air is turbulent
    left      inputs that are missing in the fitted records

    What is expected of some aircraft, and was named, is minor unless it is equivalent to another cause; what every
    aircraft has, unless it is unusually large.
    """
    evidence, held_gains, on_held = kept.evidence, kept.gains, kept.gates
    named, final = naming.named, evidence.fit
    there, last = ({one.name for one in fitted.attached} for fitted in (final, naming.evidence.fit))
    causes, minor, superseded, expected, small, later = [], [], [], [], [], []
    if turbulence.named:
        (causes if final.noise.coloured else minor).append(
            turbulence_cause(turbulence, final.flight.aircraft, held_gains[0])
        )
    for round_, held in zip(named, held_gains[1:], strict=True):
        name = round_.leader.candidate.name
        gates = (on_held[name],) if name in on_held else ()
        if name not in there:
            gates = gates if name in last else (*gates, at_least("still in the model beside later causes", 0.0, 1.0))
            (minor if name in last else superseded).append(_cause(round_.leader, naming, (), held, gates))
            continue
        if is_usual(round_.leader.effect):
            later.append((name, held))
            continue
        beside_all = sure(evidence, name, _concerned(evidence, name)), _still_matters(final, name)
        final_gates = tuple(replace(g, gate=f"{g.gate}, in the final model") for some in beside_all for g in some)
        gates = (*gates, *final_gates)
        if all_passed(final_gates):
            alone = round_.leader.effect.expected and not round_.equivalents
            group = expected if alone else causes
            group.append(_cause(_as_in(evidence, round_.leader), naming, round_.equivalents, held, gates))
        else:
            group = superseded if round_.leader.meaningful else small
            group.append(_cause(_as_in(evidence, round_.leader), naming, (), held, gates))
    minor = [replace(c, sentence=f"{c.sentence} Not confirmed on held-out data.") for c in minor]
    minor += [replace(c, sentence=f"Expected of a propeller aircraft, and added: {c.sentence}") for c in expected]
    minor += [
        *small,
        *(
            replace(c, sentence=f"{c.sentence} No longer sure, or not needed, beside the other causes.")
            for c in superseded
        ),
    ]
    missing = {m.station: m.gain for m in left}
    unexplained = still_missing(evidence, left, causes, required)
    strongest = max((*(c.statistic for c in causes), *(m.gain for m in unexplained)), default=0.0)
    usual = [(one.name, kept.structure_gain) for one in kept.structure] + later
    for name, held in usual:
        target = next(one.effect.target for one in final.attached if one.name == name)
        left_there = np.inf if unexplained else missing.get(station.coefficient(target), 0.0)
        put_in = _expected(name, evidence, held, required, left_there, strongest)
        (causes if put_in.meaningful else minor).append(put_in)
    return tuple(sorted(causes, key=lambda c: -c.statistic)), tuple(minor)


def _concerned(evidence: Evidence, name: str) -> list[int]:
    """The numbers of the fitted records that a named cause is there in."""
    one = next(a for a in evidence.fit.attached if a.name == name)
    return [r for r, record in enumerate(evidence.fit.batch.names) if one.concerns(record)]


def _still_matters(fit: FlightFit, name: str) -> tuple[Gate, ...]:
    """What the size of a named cause must pass beside those that were named after it: it matters, and is possible."""
    one = next(a for a in fit.attached if a.name == name)
    size = at_least("size, of what matters", meaningful_share(fit, one), 1.0, "size.share")
    return (*plausible_size(one), size)


def too_small(naming: Naming, seen: Sequence[Cause], missing: Sequence[MissingInput]) -> tuple[Cause, ...]:
    """What the data show beside the causes `seen` and does not matter: causes of the round that named nothing, and
    small terms. What is missing distorts small things: while something is, only a cause that gains most of what any
    of the inputs `missing`, of whatever shape, does; then it may be what is missing."""
    found = [_cause(trial, naming, (), None) for trial in minor_trials(naming, seen)]
    if missing:
        part = naming.criteria.verdict.minor_part
        return tuple(c for c in found[:1] if c.share < 1.0 and c.statistic > part * missing[0].gain)
    return (*found, *_small_terms(naming.evidence, {(c.target, c.term) for c in (*seen, *found)}))


def minor_trials(naming: Naming, seen: Sequence[Cause]) -> list[Trial]:
    """Trials of the round that named nothing that gain enough, and are only too small; most gain first, and of those
    that look alike at one place the first."""
    known, found = {(c.kind, c.target, c.term) for c in seen}, []
    for round_ in [r for r in naming.rounds if not r.named][:1]:
        for trial in sorted(round_.trials, key=lambda t: -t.gain.net):
            effect = trial.effect
            if (
                trial.gain.net > required_gain(effect, naming.criteria)
                and not trial.refuted
                and not trial.meaningful
                and plausible(trial.candidate.attached)
                and effect.key not in known
                and not any(
                    t.effect.target == effect.target and sine(t, trial) < naming.criteria.naming.alike for t in found
                )
            ):
                found.append(trial)
                known.add(effect.key)
    return found


def _as_in(evidence: Evidence, trial: Trial) -> Trial:
    """The trial with its value in the final fit, in which later causes stand beside it, and an honest 1-sigma."""
    one = next(a for a in evidence.fit.attached if a.name == trial.candidate.name)
    candidate = replace(trial.candidate, attached=one)
    share = meaningful_share(evidence.fit, one)
    std = deviation(evidence, one.name, _concerned(evidence, one.name))
    return replace(trial, candidate=candidate, std=std, share=share)


def _cause(
    trial: Trial, naming: Naming, equivalents: Sequence[Trial], held: float | None, gates: tuple[Gate, ...] = ()
) -> Cause:
    one, names = trial.candidate.attached, naming.evidence.fit.batch.names
    effect, values = one.effect, one.effect.in_words(one.values)
    dof, value, statistic = len(values), values["value"], trial.gain.raw + trial.gain.spared
    return Cause(
        kind=effect.kind,
        target=effect.target,
        term=effect.term,
        value=value,
        std=trial.std,
        unit=effect.unit,
        records=tuple(one.onsets) if effect.timed else one.records or names,
        onset_s=onset_intervals(naming.evidence, one, naming.intervals.get(one.name, {})) if effect.timed else None,
        statistic=statistic,
        dof=dof,
        held_out_gain=held,
        indistinguishable_from=tuple(_named(t) for t in equivalents),
        sentence=_sentence(one, value, len(names)),
        parameters={k: v for k, v in values.items() if k != "value" and v != effect.defaults.get(k)},
        meaningful=trial.meaningful,
        share=trial.share,
        gates=gates,
    )


def onset_intervals(evidence: Evidence, one: Attached, intervals: Intervals) -> Intervals:
    """95 % intervals of onsets with room for how long the event takes: what the data tell of it is its middle, unless
    it outlasts the records."""
    longest = max(record.duration for record in evidence.fit.flight.records)
    lasting = {f"{one.name}.{key}" for key, value in one.values.items() if key in _LASTING and value < longest}
    half = [0.5 * deviation(evidence, slot.name) for slot in evidence.fit.slots if slot.name in lasting]
    room = evidence.criteria.structure.confidence * sum(half)
    return {record: (round(low - room, 3), round(high + room, 3)) for record, (low, high) in intervals.items()}


def _expected(
    name: str, evidence: Evidence, held: float | None, required: float, left: float, strongest: float
) -> Cause:
    """Something that was put in beforehand, which is a cause (`meaningful`) only when it is unusually large.

    It must be sure, gain more than is `required`, and have lost nothing on the `held` out records. It must matter twice
    as much as what is named must, three times where the `strongest` gains more. And little may be `left` missing at its
    coefficient, as that distorts it.
    """
    fit, criteria = evidence.fit, evidence.criteria
    by = criteria.verdict
    one = next(a for a in fit.attached if a.name == name)
    effect, value, statistic = one.effect, fit[name], (fit[name] / fit.std(name)) ** 2
    share, sentence = meaningful_share(fit, one), effect_sentence(*one.effect.key, value)
    notable = by.structure * (by.structure_with_others if strongest > statistic else 1.0)
    usual = one.nuisance or is_induced_drag(effect, value, fit)
    gates = (
        at_most("expected of any aircraft", float(usual), 0.0),
        at_least("size, of what matters", share, notable, "verdict.structure"),
        at_least("gain", statistic, required, "turbulence.left"),
        *matters(share, statistic, clear_gain(evidence.fit), criteria),
        *sure(evidence, name),
        at_least("gain on held-out records", 0.0 if held is None else held, 0.0),
        mostly_gone(statistic, left, criteria.doubt),
    )
    meaningful = all_passed(gates)
    return Cause(
        kind=effect.kind,
        target=effect.target,
        term=effect.term,
        value=value,
        std=deviation(evidence, name),
        unit=effect.unit,
        records=fit.batch.names,
        onset_s=None,
        statistic=statistic,
        dof=1,
        held_out_gain=held,
        indistinguishable_from=(),
        parameters={},
        meaningful=meaningful,
        share=share,
        gates=gates,
        sentence=sentence if meaningful or one.nuisance else f"Expected of any aircraft, and added: {sentence}",
    )


def _named(trial: Trial) -> Mapping[str, object]:
    effect = trial.effect
    return {
        "kind": effect.kind,
        "target": effect.target,
        "term": effect.term,
        "value": float(trial.candidate.attached.values["value"]),
        "unit": effect.unit,
        "gain": trial.gain.raw,
    }


def _sentence(one: Attached, value: float, records: int) -> str:
    effect = one.effect
    text = effect_sentence(effect.kind, effect.target, effect.term, value)
    if effect.timed:
        return text[:-1] + ": " + ", ".join(f"{r} from t = {t:.1f} s" for r, t in one.onsets.items()) + "."
    if one.records and len(one.records) < records:
        others = " (or the other way in the others: free derivatives show differences between records only)"
        return text[:-1] + f", in {', '.join(one.records)} only{others if effect.relative else ''}."
    return text


def turbulence_cause(turbulence: Turbulence, aircraft: Aircraft, held: float | None) -> Cause:
    effect = turbulence_effect("")
    return Cause(
        kind=effect.kind,
        target=effect.target,
        term=None,
        value=turbulence.sigma,
        std=turbulence.std,
        unit=effect.unit,
        records=turbulence.records,
        onset_s=None,
        statistic=turbulence.gain,
        dof=1,
        held_out_gain=held,
        indistinguishable_from=(),
        sentence=effect_sentence(*effect.key, turbulence.sigma),
        parameters={},
        meaningful=True,
        share=turbulence.sigma / (effect.smallest_that_matters(aircraft) or 1.0),
    )


def _small_terms(evidence: Evidence, known: set) -> list[Cause]:
    """Terms that the data want clearly but that are too small to matter, from the marginalised posterior."""
    fit, k, size = evidence.fit, len(evidence.fit.slots), variation(evidence.fit)
    sigmas, matter = evidence.criteria.verdict.small_term, evidence.criteria.size.share
    found = []
    for i, (coefficient, term) in enumerate(evidence.terms):
        mean, std = float(evidence.newton[k + i]), float(np.sqrt(evidence.covariance[k + i, k + i]))
        if abs(mean) < sigmas * std or (coefficient, term) in known:
            continue
        factor = evidence.factors[i]
        series = np.broadcast_to(parse_term(term).evaluate(fit.regressors), fit.batch.live.shape)
        left = unlike_derivatives(fit, coefficient, mean * factor * series)
        share = float(np.std(left[fit.batch.live])) / size[coefficient]
        if share > matter:
            continue  # not small: it stands for something that is missing, and the verdict says where
        effect = unsteady_aero(coefficient) if "dot" in term else aero_term(coefficient, term)
        sentence = effect_sentence(*effect.key, mean * factor)
        found.append(
            Cause(
                kind=effect.kind,
                target=coefficient,
                term=effect.term,
                value=mean * factor,
                std=std * factor,
                unit=effect.unit,
                records=fit.batch.names,
                onset_s=None,
                statistic=(mean / std) ** 2,
                dof=1,
                held_out_gain=None,
                indistinguishable_from=(),
                parameters={},
                meaningful=False,
                share=share / matter,
                sentence=f"Real, but too small to matter ({100 * share:.1f} % of {coefficient}): {sentence}",
            )
        )
    return sorted(found, key=lambda c: -c.statistic)[: evidence.criteria.numerics.naming.small_terms]


def still_missing(
    evidence: Evidence,
    left: Sequence[MissingInput],
    causes: Sequence[Cause],
    required: float,
    share: float | None = None,
) -> list[MissingInput]:
    """Where something enters that no cause of the catalogue explains, largest gain first.

    These are the inputs `left` and an oscillation. Each must gain more than the criterion for a missing input, than is
    `required` in turbulence and than rough `causes` leave. It must also make more than a `share` of the variation, by
    default what matters of a cause.
    """
    by, share = evidence.criteria.naming, evidence.criteria.size.share if share is None else share
    rough = sum((by.left_by_an_event if one.onset_s else by.left_by_a_cause) * one.statistic for one in causes)
    enough = max(evidence.criteria.verdict.missing, required, rough)
    if evidence.fit.noise.coloured:  # slow wind is part of turbulence, whatever its spectrum
        left = [m for m in left if m.station not in _OF_THE_AIR]
    found = [*left, *missing_oscillation(evidence)]
    return sorted(
        (m for m in found if m.gain > enough and missing_share(evidence.fit, m) > share), key=lambda m: -m.gain
    )


def verdict_of(
    causes: Sequence[Cause], minor: Sequence[Cause], unexplained: Sequence[MissingInput], naming: Naming, fit: FlightFit
) -> tuple[str, str, str]:
    """(verdict, its sentence, a remark besides one that names nothing)."""
    if causes:
        stated = " ".join(c.statement for c in causes)
        if unexplained:
            where = _where(unexplained[0], fit.batch.names)
            return "partly explained", f"{stated} Something more is missing: it enters at {where}.", ""
        return "explained", stated, ""
    if unexplained:
        air, share = unexplained[0].place.kind == "wind", missing_share(fit, unexplained[0])
        size = f", {unexplained[0].rms:.2g} m/s" if air else f", {100 * share:.0f} % of it"
        where = _where(unexplained[0], fit.batch.names, size)
        return (
            "unexplained",
            f"The simulation misses something that no cause in the catalogue explains; it enters at {where}.",
            "",
        )
    remark = " What is expected of such an aircraft, or too small to matter, is listed as minor." if minor else ""
    return "adequate", ADEQUATE, f"{remark}{_hint(naming)}"


def _hint(naming: Naming) -> str:
    """What comes nearest to a cause, of a size that matters, and is not clear enough to be one."""
    trials = [trial for round_ in naming.rounds if not round_.named for trial in round_.trials]
    part, criteria = naming.criteria.verdict.hint, naming.criteria
    near = [
        t for t in trials if t.gain.net > part * required_gain(t.effect, criteria) and not t.refuted and t.meaningful
    ]
    if not near:
        return ""
    most = max(near, key=lambda t: t.gain.net)
    one = most.candidate.attached
    sentence = _sentence(one, one.effect.in_words(one.values)["value"], len(naming.evidence.fit.batch.names))
    stated, gained = sentence[0].lower() + sentence[1:-1], _gain(most.gain.raw)
    return f" Not clear enough to be named, but worth a look: {stated} ({gained})."


def _where(missing: MissingInput, fitted: Sequence[str], size: str = "") -> str:
    oscillation = f"an oscillation of {missing.frequency:.2g} Hz, " if missing.frequency else ""
    unseen = "" if missing.concerns(fitted) else f", in {', '.join(missing.history)}, which no fit has seen"
    return f"{missing.place.words}{size} ({oscillation}{_gain(missing.gain)}){unseen}"


def _gain(gain: float) -> str:
    return f"log likelihood ratio {0.5 * gain:.0f}"
