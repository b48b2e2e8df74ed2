"""What follows from the explanations: probabilities of causes, sets that cannot be told apart, what is unexplained.

Nothing is decided here but by probability: a name is given where it is worth the cost of being wrong (`Priors.named`).
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr

from casid.diagnosis.explanations.explanation import CauseColumn, Explanation
from casid.diagnosis.explanations.search import Found


@dataclass(frozen=True, eq=False, kw_only=True)
class Belief:
    """What is believed of a cause.

    probability  that it is there;  matters  that it is there and of a size that matters
    log_odds     of all explanations that have it against all that have not
    size, std    of its size, averaged over the explanations that have it
    column       its most probable shape: the column that stood for it
    alike        the rest of the smallest set of causes that stand for each other and holds 95 %, with probabilities
    together     probability that one of that set is there and matters
    """

    name: str
    kind: str
    probability: float
    matters: float
    log_odds: float
    size: float
    std: float
    column: CauseColumn
    alike: tuple[tuple[str, float], ...]
    together: float


@dataclass(frozen=True, eq=False, kw_only=True)
class Posterior:
    """Probabilities, all of them within these columns, this noise and these priors.

    explanations  names of all that they say -> probability, most probable first
    causes        most probable first;  unknown  entrance -> probability that what enters there is as large as matters
    adequate      probability that nothing that matters is wrong
    best          the most probable explanation
    """

    explanations: Mapping[frozenset[str], float]
    causes: tuple[Belief, ...]
    unknown: Mapping[str, float]
    adequate: float
    best: Explanation
    threshold: float

    @property
    def named(self) -> tuple[Belief, ...]:
        """The causes worth their names, most probable first: of a set that stand for each other the first, which none
        of the others of its set is more probable than."""
        found: list[Belief] = []
        for one in self.causes:
            taken = {name for other in found for name in (other.name, *(alike for alike, _ in other.alike))}
            least = max((p for _, p in one.alike), default=0.0)
            alone = not taken & {one.name, *(name for name, _ in one.alike)}
            if one.together >= self.threshold and alone and one.probability >= least:
                found.append(one)
        return tuple(found)


def posterior(found: Found) -> Posterior:
    """What the explanations of a search say together."""
    logs = np.array([one.log for one in found.explanations])
    weights = np.exp(logs - _log_sum(logs)).tolist()
    by_names: dict[frozenset[str], float] = defaultdict(float)
    unknown: dict[str, float] = defaultdict(float)
    adequate = 0.0
    for one, weight in zip(found.explanations, weights, strict=True):
        by_names[one.names] += weight
        nothing = weight
        for (name, _, _), large in zip(one.unknown, one.large, strict=True):
            unknown[name] += weight * large
            nothing *= 1.0 - large
        for p in _matter(found.innovations.causes, one):
            nothing *= 1.0 - p
        adequate += nothing
    return Posterior(
        explanations=_ranked(by_names),
        causes=_beliefs(found, weights),
        unknown=_ranked(unknown),
        adequate=min(adequate, 1.0),
        best=found.explanations[0],
        threshold=found.priors.named,
    )


def _log_sum(logs: Sequence[float] | np.ndarray) -> float:
    """Logarithm of the sum of exponentials."""
    return float(np.logaddexp.reduce(np.asarray(logs, dtype=float))) if len(logs) else -np.inf


def _ranked(of: Mapping) -> dict:
    return dict(sorted(of.items(), key=lambda item: (-item[1], str(sorted(item[0])))))


def _matter(columns: Sequence[CauseColumn], one: Explanation) -> list[float]:
    """Of each element of an explanation the probability that its size matters."""
    found = []
    for element, (mean, std) in zip(one.elements, one.amplitudes, strict=True):
        least = columns[element.column].matters
        found.append(float(ndtr((mean - least) / std) + ndtr((-least - mean) / std)))
    return found


@dataclass(frozen=True, eq=False, kw_only=True)
class _Part:
    """A cause in an explanation: the explanation's number, log and weight, its column, size, and whether that
    matters."""

    number: int
    log: float
    weight: float
    column: CauseColumn
    size: float
    std: float
    matters: float


@dataclass(frozen=True, eq=False, kw_only=True)
class _About:
    """By name of a cause: its parts in all explanations, its probability, and the column of its most probable part;
    and the logs of all explanations."""

    found: Found
    parts: Mapping[str, Sequence[_Part]]
    likely: Mapping[str, float]
    foremost: Mapping[str, CauseColumn]
    logs: Sequence[float]


def _beliefs(found: Found, weights: Sequence[float]) -> tuple[Belief, ...]:
    parts: dict[str, list[_Part]] = defaultdict(list)
    columns = found.innovations.causes
    for number, (one, weight) in enumerate(zip(found.explanations, weights, strict=True)):
        matter = _matter(columns, one)
        for element, (mean, std), p in zip(one.elements, one.amplitudes, matter, strict=True):
            column = columns[element.column]
            part = _Part(
                number=number,
                log=one.log,
                weight=weight,
                column=column,
                size=mean * column.value,
                std=std * abs(column.value),
                matters=p,
            )
            parts[column.name].append(part)
    about = _About(
        found=found,
        parts=parts,
        likely={name: min(sum(p.weight for p in of), 1.0) for name, of in parts.items()},
        foremost={name: max(of, key=lambda p: (p.weight, -p.number)).column for name, of in parts.items()},
        logs=[one.log for one in found.explanations],
    )
    beliefs = [_belief(about, name) for name in parts]
    return tuple(sorted(beliefs, key=lambda one: (-one.probability, -one.log_odds, one.name)))


def _belief(about: _About, name: str) -> Belief:
    mine = about.parts[name]
    weight = np.array([p.weight for p in mine])
    share = weight / max(float(weight.sum()), 1e-300)
    sizes, stds = np.array([p.size for p in mine]), np.array([p.std for p in mine])
    size = float(share @ sizes)
    having = {p.number for p in mine}
    against = _log_sum([log for number, log in enumerate(about.logs) if number not in having])
    if name in about.found.without:
        against = max(against, about.found.without[name].log)
    alike, together = _set(about, name)
    return Belief(
        name=name,
        kind=about.foremost[name].kind,
        probability=about.likely[name],
        matters=float(weight @ np.array([p.matters for p in mine])),
        log_odds=_log_sum([p.log for p in mine]) - against,
        size=size,
        std=float(np.sqrt(share @ (stds**2 + (sizes - size) ** 2))),
        column=about.foremost[name],
        alike=alike,
        together=together,
    )


def _set(about: _About, name: str) -> tuple[tuple[tuple[str, float], ...], float]:
    """The other members of the smallest set about a cause that holds `Priors.holds`, and the probability that one of
    all these is there and matters."""
    parts, priors = about.parts, about.found.priors
    there = {p.number: p.weight for p in parts[name]}
    matters = {p.number: p.weight * p.matters for p in parts[name]}
    members: list[str] = []
    rivals = [o for o in parts if o != name and about.likely[o] > priors.adds and _exchangeable(about, name, o)]
    while sum(there.values()) < priors.holds and rivals:
        adds = {other: sum(p.weight for p in parts[other] if p.number not in there) for other in rivals}
        best = max(rivals, key=lambda other: (adds[other], other))
        if adds[best] < priors.adds:
            break
        rivals.remove(best)
        members.append(best)
        for p in parts[best]:
            there[p.number] = p.weight
            matters[p.number] = max(matters.get(p.number, 0.0), p.weight * p.matters)
    stated = sorted(((other, about.likely[other]) for other in members), key=lambda one: (-one[1], one[0]))
    return tuple(stated), min(sum(matters.values()), 1.0)


def _exchangeable(about: _About, one: str, other: str) -> bool:
    """Whether two causes may stand for each other: by their tags, or by how alike their responses are."""
    a, b = about.foremost[one], about.foremost[other]
    columns = about.found.innovations.causes
    if a.alike and a.alike == b.alike:
        return True
    of_one, of_other = ([i for i, c in enumerate(columns) if c.name == name] for name in (one, other))
    if a in columns and b in columns:
        of_one, of_other = [columns.index(a)], [columns.index(b)]
    return (
        bool(of_one and of_other)
        and float(np.abs(about.found.alike[np.ix_(of_one, of_other)]).max()) > about.found.priors.alike
    )
