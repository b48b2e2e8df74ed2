"""Causes that begin at a time: their onsets with intervals, and sets of coefficients that change together."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import partial, reduce

import numpy as np

from casid.diagnosis import comparisons as ask
from casid.diagnosis.comparisons import Gate
from casid.diagnosis.criteria import Criteria
from casid.diagnosis.evidence.evidence import Evidence, weigh
from casid.diagnosis.evidence.fingerprints import Projection, fingerprints, history, onset_grid, prints_of, products_at
from casid.diagnosis.evidence.screening import Candidate, Screen, grown_sets
from casid.diagnosis.flight.evaluation import FlightFit, Free, gram_of, scaled_inverse
from casid.diagnosis.flight.fit import fit
from casid.diagnosis.flight.hypothesis import Attached
from casid.filtering.kernel import SAMPLES
from casid.model import operators
from casid.model.causes.aerodynamics import configuration_change
from casid.model.effect import with_grid
from casid.model.station import coefficient

Intervals = dict[str, tuple[float, float]]


def moved_onsets(evidence: Evidence, one: Attached, far: bool = True) -> tuple[Attached, Intervals]:
    """Move each onset of an event to the peak of its profile likelihood.

    The profile is the predicted decrease of the deviance when the event of fitted size is shifted in one record. All
    estimated values, including the size, adapt; the onsets in other records stay. The profile covers the whole record
    and is finer around the present onset. While the surface concerned does not move, the profile is constant and the
    interval wide. It ends where the statistic has dropped by that of a significant number: an onset is no regular
    parameter, of which a drop of 3.8 would hold 95 %. All of 58 onsets of blind flights were inside
    (problems/blind/results.md, seeds 2004 to 2008).

    Without `far` the profile covers what is near the present onset.

    intervals  95 % intervals of the onsets [s], by record
    """
    judge = Screen(evidence)
    moved = one
    intervals = {}
    if one.effect.event.lasts:  # with another size, an event that is moved to where nothing happens would not be missed
        judge = judge.holding(one.name)
    times = {record: _looked_at(evidence, record, onset, far) for record, onset in one.onsets.items()}
    # Records are independent: all onsets are shifted at once, but where each leaves the end of its record where it is.
    for records in [[record] for record in times] if one.effect.event.lasts else [list(times)]:
        most = max(len(times[record]) for record in records)
        at = ({record: float(times[record][min(i, len(times[record]) - 1)]) for record in records} for i in range(most))
        profile = _profile(judge, one, (begun(one, onsets) for onsets in at))
        for record in records:
            t = times[record]
            drops = profile[record][: len(t)]
            best = int(np.argmax(drops))
            if drops[best] > 0.0:
                moved = begun(moved, {**moved.onsets, record: float(t[best])})
            intervals[record] = _within(drops, t, evidence)
    return moved, intervals


def _profile(judge: Screen, one: Attached, others: Iterable[Attached]) -> dict[str, np.ndarray]:
    """Record -> (others,) predicted decrease of the deviance in that record if an event were another.

    It is zero where the two differ by no more than the noise of the recorded input: the record cannot separate them.
    """
    base = judge.base
    now = history(judge.base, one)
    changes = []
    noise = np.array([base.noise.inputs.get(name, 0.0) for name in base.model.disturbances])

    def histories() -> Iterator[np.ndarray]:
        for other in others:
            change = history(base, other) - now
            changes.append(np.abs(change).max(axis=0))
            yield change

    prints = prints_of(judge.evidence, one.effect, histories())
    unseen = (np.array(changes) <= judge.criteria.significance.sigmas * noise).all(axis=2)
    drops = np.array([[judge.drop(print_, r) for r in range(len(base.batch.names))] for print_ in prints])
    return dict(zip(base.batch.names, np.where(unseen, 0.0, drops).T, strict=True))


def begun(one: Attached, onsets: Mapping[str, float]) -> Attached:
    """The event with other onsets. One that lasts for a time of its own ends when it ended before, in the record that
    is moved most."""
    lasts = one.effect.event.lasts
    if lasts is None:
        return replace(one, onsets=dict(onsets))
    sooner = max((one.onsets[record] - onset for record, onset in onsets.items()), key=abs)
    return replace(one, onsets=dict(onsets), values={**one.values, lasts: max(one.values[lasts] + sooner, 0.0)})


def end_intervals(evidence: Evidence, one: Attached) -> Intervals:
    """Record -> 95 % interval of the end [s] of an event that `lasts`, from its profile with the onset held.

    While the surface concerned does not move, the end is unknown. An interval that reaches the end of the record
    may not have ended."""
    lasts = one.effect.event.lasts
    found = dict[str, tuple[float, float]]()
    if lasts is None:
        return found
    judge = Screen(evidence).holding(one.name)
    step = evidence.criteria.numerics.events.coarse
    for record in evidence.fit.flight.records:
        if (onset := one.onsets.get(record.name)) is not None and onset + step < record.t[-1]:
            ends = np.arange(onset, record.t[-1], step)[1:]
            shapes = ({**one.values, lasts: float(end - onset)} for end in ends)
            others = (replace(one, onsets={record.name: onset}, values=values) for values in shapes)
            found[record.name] = _within(_profile(judge, one, others)[record.name], ends, evidence)
    return found


def _within(drops: np.ndarray, t: np.ndarray, evidence: Evidence) -> tuple[float, float]:
    """Times between which a profile is significantly as high as at its peak: where it is first too low, to within the
    spacing of its points."""
    inside = np.flatnonzero(drops > drops.max() - evidence.criteria.significance.chance)
    fine = evidence.criteria.numerics.events.fine
    low = max(inside[0] - 1, 0)
    high = min(inside[-1] + 1, len(t) - 1)
    return round(float(t[low]) - 0.5 * fine, 3), round(float(t[high]) + 0.5 * fine, 3)


def _looked_at(evidence: Evidence, name: str, onset: float, far: bool) -> np.ndarray:
    """Times [s] at which the profile of an onset is evaluated: `far`, the whole record; finer around the present."""
    record = next(r for r in evidence.fit.flight.records if r.name == name)
    numerics = evidence.criteria.numerics.events
    edge = numerics.step
    near = onset + np.arange(-edge, edge + numerics.fine / 2, numerics.fine)
    everywhere = record.t[0] + onset_grid(evidence, numerics.coarse) if far else near
    times = np.union1d(np.round(near, 6), np.round(everywhere, 6))
    inside = times[(times >= record.t[0] + edge) & (times <= record.t[-1] - edge)]
    return inside if len(inside) else np.array([onset])  # of a record too short for any other


def at_peak(
    evidence: Evidence, moves: int | None = None, free: Free = "all", which: int = -1
) -> tuple[Evidence, Intervals]:
    """Move the onsets of one effect until they stay, or until a further move does not help.

    All onsets are first moved together by the linearisation of the fit, and then each to the peak of its own profile,
    which covers the whole record.

    evidence   evidence of the present fit
    moves      largest number of moves; by default that of the criteria
    free       what is estimated again after each move
    which      index of the effect; by default the last one
    evidence   evidence of the fit with the moved onsets
    intervals  95 % intervals of the onsets [s], by record
    """
    interval: Intervals = {}
    numerics = evidence.criteria.numerics
    moves = numerics.fit.repeats if moves is None else moves
    for _ in range(moves):
        evidence = _slid(evidence, moves, free, which)
        fitted = evidence.fit
        before = fitted.attached[which]
        moved, interval = moved_onsets(evidence, before)
        if all(abs(moved.onsets[r] - t) < numerics.events.fine / 2 for r, t in before.onsets.items()):
            break
        attached = [moved if one is before else one for one in fitted.attached]
        other = fit(fitted.flight, attached, fitted.noise, fitted, free=free, extent="rough")
        if other.deviance > fitted.deviance + evidence.criteria.significance.chance:
            # The fit refutes the far peak, which the linearisation has made: what is near the present onset holds.
            interval = moved_onsets(evidence, before, far=False)[1]
            break
        if other.deviance > fitted.deviance:
            # The fit does not confirm the profile: both onsets are possible.
            interval = {
                r: (min(low, before.onsets[r]), max(high, before.onsets[r])) for r, (low, high) in interval.items()
            }
            break
        evidence = weigh(other, discrepancy=free == "all")
    return evidence, interval


def _slid(evidence: Evidence, moves: int, free: Free, which: int) -> Evidence:
    """Move all onsets of an effect together by at most `moves` Gauss-Newton steps, for as long as they help.

    Onsets and the duration of an event lie in a narrow valley of the deviance, in which none can move alone.
    """
    numerics = evidence.criteria.numerics.events
    for _ in range(moves):
        fitted = evidence.fit
        before = fitted.attached[which]
        onsets = _together(evidence, before)
        if all(abs(onsets[r] - t) < numerics.fine / 2 for r, t in before.onsets.items()):
            break
        attached = [replace(one, onsets=onsets) if one is before else one for one in fitted.attached]
        other = fit(fitted.flight, attached, fitted.noise, fitted, free=free, extent="rough")
        if other.deviance > fitted.deviance:
            break
        evidence = weigh(other, discrepancy=free == "all")
    return evidence


def _together(evidence: Evidence, one: Attached) -> dict[str, float]:
    """Record -> onset after one Gauss-Newton step of all onsets of an effect, with all estimated values adapting.

    The step has a prior with the width of the fine part of the profile, so that an onset that is not identifiable
    stays.
    """
    base = evidence.fit
    judge = Screen(evidence)
    names = list(evidence.fit.batch.names)
    rows = [names.index(name) for name in one.onsets]
    numerics = evidence.criteria.numerics.events
    near = edge = numerics.step
    fine = numerics.fine
    sooner, later = (
        history(base, replace(one, onsets={record: onset + h for record, onset in one.onsets.items()}))
        for h in (-0.5 * fine, 0.5 * fine)
    )
    (slope,) = prints_of(evidence, one.effect, [later - sooner])
    C = slope.cross[rows]
    gram = (np.diag(slope.square[rows]) - C @ judge.covariance @ C.T) / fine**2 + np.eye(len(rows)) / near**2
    step = np.clip(np.linalg.solve(gram, (slope.match[rows] - C @ judge.newton) / fine), -near, near)
    records = [base.flight.records[r] for r in rows]
    return {
        record.name: float(np.clip(onset + d, record.t[0] + edge, record.t[-1] - edge))
        for record, onset, d in zip(records, one.onsets.values(), step, strict=True)
    }


def configuration_changes(evidence: Evidence) -> list[Candidate]:
    """The best set of coefficients that change together, as a list of one candidate or none.

    Records, onsets and duration are those with the largest joint statistic less its penalty. The sizes are the same in
    all of these records.
    """
    base = evidence.fit
    price = Screen(evidence).price
    criteria = evidence.criteria
    names = base.batch.names
    coefficients = base.flight.coefficients
    onsets = onset_grid(evidence)
    durations = [values["duration"] for c in coefficients[:1] for values in configuration_change(c).further.grid]
    best: Candidate | None = None
    every = _steps(evidence, coefficients, onsets, durations) if len(onsets) and coefficients else []
    for duration, steps in zip(durations, every, strict=False):
        for chosen in grown_sets(len(steps), partial(_statistics, steps), criteria.numerics.naming.trials):
            statistic, sizes, stds = _joint(_Steps.joined([steps[r].at(o) for r, o in chosen.items()], _sum))
            members = _members(np.abs(sizes[0]) / stds[0], criteria)
            tries = float(len(onsets)) ** len(chosen) * 2.0 ** len(names) * len(durations)
            net = float(statistic[0]) - (len(members) + 1) * price - 2.0 * np.log(tries)
            if best is not None and net < best.net:
                continue
            values = {("value" if c == members[0] else coefficients[c]): float(sizes[0, c]) for c in members}
            attached = Attached(
                effect=configuration_change("+".join(coefficients[c] for c in members)),
                values=values | {"duration": duration},
                onsets={names[r]: float(base.flight.records[r].t[0] + onsets[o]) for r, o in chosen.items()},
            )
            best = Candidate(
                attached=attached,
                statistic=float(statistic[0]),
                net=net,
                value=float(sizes[0, members[0]]),
                std=float(stds[0, members[0]]),
                surviving=1.0,
            )
    return [] if best is None else [best]


def _members(strength: np.ndarray, criteria: Criteria) -> list[int]:
    """Indices of the coefficients that take part, by their size in standard deviations."""
    strong = np.flatnonzero(strength > max(criteria.significance.sigmas, criteria.size.share * strength.max()))
    return [int(c) for c in strong] or [int(np.argmax(strength))]


def sudden(evidence: Evidence, one: Attached) -> Gate:
    """The gate on a jump: its statistic must clearly exceed that of a slow change of the same effect.

    The slow change is a cubic polynomial of time in each record. An effect that depends on speed in a long record, or
    on anything else that drifts, resembles a jump somewhere. An effect that acts only now and then fits both
    descriptions, and counts as sudden.
    """
    base = evidence.fit
    names = evidence.fit.batch.names
    rows = [names.index(record) for record in one.onsets]
    live = base.batch.live[:, rows]
    powers = evidence.criteria.numerics.events.slow_polynomials
    whole = history(base, replace(one, onsets=dict.fromkeys(one.onsets, -np.inf)))
    acting = [s for s in range(whole.shape[2]) if _mean_part(whole[:, rows, s][live]) > 0.5]  # most of it
    if not acting:
        return _sudden(np.inf, evidence)
    jump = Projection.shared(evidence, base.filter.whiten_histories(acting, history(base, one)[..., acting]))
    slow = np.zeros((*whole.shape[:2], len(acting), powers))
    for r in rows:
        own = base.batch.live[:, r]
        shapes = np.polynomial.legendre.legvander(np.linspace(-1.0, 1.0, int(own.sum())), powers - 1)
        slow[own, r] = whole[own, r][:, acting, None] * shapes[:, None]
    white = base.filter.whiten_histories(np.repeat(acting, powers), slow.reshape(*whole.shape[:2], -1))
    products = products_at(evidence, {base.model.disturbances[s]: slow[:, :, i] for i, s in enumerate(acting)})
    cross, match = zip(*products.values(), strict=True)
    grams = np.stack([gram_of(white[:, r].reshape(-1, white.shape[3])) for r in range(white.shape[1])])
    slower = Projection.by_record(evidence, grams, (np.concatenate(cross, axis=2), np.concatenate(match, axis=1)))
    return _sudden(_gain_of(jump) / max(_gain_of(slower), 1e-300), evidence)


def _sudden(over_slow: float, evidence: Evidence) -> Gate:
    """The gate on the statistic of a jump over that of a slow change of the same effect."""
    least = 1.0 / evidence.criteria.numerics.events.sudden
    return ask.SUDDEN.of(over_slow, least, "numerics.events.slow_polynomials")


def alone(evidence: Evidence, one: Attached) -> Gate:
    """The gate on a gust or a shear where there are no kinematics: air that always moves has a largest one too.

    The statistic of one of this length at a time has a mean of one where only noise is left. In units of its mean at
    all other times of these records, that of this one must be significant for the best of many.
    """
    further = {name: value for name, value in one.values.items() if name != "value"}
    step = evidence.criteria.numerics.events.gust_step
    records = evidence.fit.flight.records
    judge = Screen(evidence, exact=True)
    lasts = min(further.values())
    shortest = min(min(shape.values()) for shape in one.effect.further.grid)
    apart = lasts if lasts < min(record.duration for record in records) else shortest
    own = 0.0
    others = list[float]()
    for print_ in fingerprints(evidence, [with_grid(one.effect, further)], onset_grid(evidence, step, lasts)):
        for r, keep in enumerate(np.eye(len(records))):
            begins = float(records[r].t[0]) + (print_.onset or 0.0)
            if begins > records[r].t[-1]:
                continue
            statistic = judge.score([print_], keep[None])[0]
            if abs(begins - one.onsets.get(records[r].name, np.inf)) < apart:
                own = max(own, statistic)
            else:
                others.append(statistic)
    least = evidence.criteria.significance.search
    return ask.ALONE.of(own / max(float(np.mean(others)) if others else 1.0, 1.0), least)


def _mean_part(series: np.ndarray) -> float:
    """Part of the mean square of a time series that is due to its mean; near 1 for an effect that always acts."""
    return float(np.mean(series)) ** 2 / max(float(np.mean(series**2)), 1e-300)


def _gain_of(left: Projection) -> float:
    """Predicted decrease of the deviance by independent responses."""
    return float(left.match @ scaled_inverse(left.gram, rcond=1e-8) @ left.match)


@dataclass(frozen=True, eq=False, kw_only=True)
class _Steps:
    """Normal equations of unit steps of c coefficients at several onsets in one record."""

    gram: np.ndarray  # (onsets, c, c)
    cross: np.ndarray  # (onsets, k, c) with the fitted parameters
    spent: np.ndarray  # (onsets, k, c) covariance of the parameters times cross
    match: np.ndarray  # (onsets, c) with the residuals of the fit

    def at(self, onset: int) -> _Steps:
        return _Steps.joined([self], lambda parts: parts[0][[onset]])

    @classmethod
    def joined(cls, parts: Sequence[_Steps], by: Callable[[list[np.ndarray]], np.ndarray]) -> _Steps:
        return cls(**{part.name: by([getattr(one, part.name) for one in parts]) for part in fields(cls)})


def _sum(parts: list[np.ndarray]) -> np.ndarray:
    """Sum over records, for steps of the same size in each."""
    return reduce(np.add, parts)


def _steps(
    evidence: Evidence, coefficients: Sequence[str], onsets: np.ndarray, durations: Sequence[float]
) -> list[list[_Steps]]:
    """For every duration and record the normal equations of the steps at these times after its first sample."""
    base = evidence.fit
    c = len(coefficients)
    since = base.batch.t - base.batch.t[0]
    together = SAMPLES
    names = [coefficient(name) for name in coefficients]
    stations = [base.model.disturbances.index(name) for name in names]
    shapes = [operators.transition(since.ravel(), o, d).reshape(since.shape) for d in durations for o in onsets]
    both = products_at(evidence, dict.fromkeys(names, np.stack(shapes, axis=2))).values()
    cross = np.stack([own.swapaxes(1, 2) for own, _ in both], axis=3)
    match = np.stack([own for _, own in both], axis=2) - cross.swapaxes(2, 3) @ evidence.newton
    found = []
    for first in range(0, len(shapes), len(onsets)):
        some = slice(first, first + len(onsets))
        series = np.repeat(np.stack(shapes[some], axis=2), c, axis=2)
        grams = np.zeros((since.shape[1], len(onsets), c, c))
        for _, part in base.filter.histories_in_parts(stations * len(onsets), series, together):
            for own, white in zip(grams, part, strict=True):
                blocks = white.reshape(-1, len(onsets), c)
                for i in range(len(onsets)):
                    own[i] += blocks[:, i].T @ blocks[:, i]
        of_records = zip(grams, cross[:, some], match[:, some], strict=True)
        found.append([_Steps(gram=g, cross=x, spent=evidence.covariance @ x, match=m) for g, x, m in of_records])
    return found


def _joint(steps: _Steps) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Joint statistic of coefficients that change together, fitted parameters eliminated.

    statistic  (onsets,) Predicted decrease of the deviance
    sizes      (onsets, c) Estimated steps
    stds       (onsets, c) Their standard deviations
    """
    inverse = scaled_inverse(steps.gram - steps.cross.swapaxes(1, 2) @ steps.spent, rcond=1e-8)
    sizes = (inverse @ steps.match[..., None])[..., 0]
    stds = np.sqrt(np.maximum(np.diagonal(inverse, axis1=1, axis2=2), 1e-300))
    return np.sum(steps.match * sizes, axis=1), sizes, stds


def _statistics(steps: Sequence[_Steps], others: Mapping[int, int], records: Sequence[int]) -> np.ndarray:
    """(onsets, records) Statistic of each onset in a record together with the onsets chosen in `others`."""
    beside = [steps[other].at(onset) for other, onset in others.items()]
    return np.stack([_joint(_Steps.joined([steps[r], *beside], _sum))[0] for r in records], axis=1)


def in_its_records(evidence: Evidence, one: Attached) -> Attached:
    """The event in those records in which, at its size and best onset, it lowers the deviance.

    An onset at either end of a record is not used: an event that helps most when it hardly acts is not an event. A
    record that would be as well without it, as while a stuck surface has no command, does not have it.
    """
    base = evidence.fit
    judge = Screen(evidence)
    criteria = evidence.criteria
    if len(one.onsets) > 1:
        others = [replace(one, onsets={k: v for k, v in one.onsets.items() if k != name}) for name in one.onsets]
        profile = _profile(Screen(evidence).holding(one.name), one, others)
        needs = {name: -float(profile[name][i]) for i, name in enumerate(one.onsets)}
        least = min(criteria.significance.chance, max(needs.values()))
        one = replace(one, onsets={k: v for k, v in one.onsets.items() if needs[k] >= least})
    if len(one.onsets) == len(base.flight.records):
        return one
    further = {k: v for k, v in one.values.items() if k != "value"}
    effect = with_grid(one.effect, {**further, "value": one.values["value"]})
    step = criteria.numerics.events.gust_step
    edge = criteria.numerics.events.step
    prints = fingerprints(evidence, [effect], onset_grid(evidence, step, further.get("length", np.inf)))
    onsets = dict(one.onsets)
    for r, record in enumerate(base.flight.records):
        if record.name in onsets:
            continue
        inside = [print_ for print_ in prints if edge <= (print_.onset or 0.0) <= record.duration - edge]
        drops = [judge.drop(print_, r) for print_ in inside]
        best = int(np.argmax(drops)) if drops else 0
        if 0 < best < len(drops) - 1 and drops[best] > criteria.significance.search:
            onsets[record.name] = float(record.t[0] + (inside[best].onset or 0.0))
    return replace(one, onsets=onsets)


def weak_members(fit: FlightFit, attached: Attached) -> Sequence[str]:
    """Coefficients of a fitted configuration change that are not significant."""
    sigmas = fit.criteria.significance.sigmas
    names = attached.effect.members
    slots = {c: attached.name + ("" if c == names[0] else f".{c}") for c in names}
    return [c for c, slot in slots.items() if abs(fit[slot]) < sigmas * fit.std(slot)]
