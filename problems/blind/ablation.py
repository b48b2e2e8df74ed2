"""Which criteria of the diagnosis decided anything on a campaign? Read from its decision traces.

A gate is pivotal when it is the only one of its decision that failed: without it the cause would have gone on. A
criterion that is never pivotal changed no decision of the campaign by itself.

The range of a criterion has the values at which every decision comes out as it did: each decision is replayed with the
thresholds of this criterion moved, its other gates and the alternatives as they were. A criterion that is asked outside
of gates, too, may change something within its range.

A number that no gate names is moved in campaigns of its own: `--moved FACTOR` prints a file of criteria in which all
chosen numbers without a gate in these traces are multiplied or divided by the factor, as a seed says. The inverse
factor moves each the other way.

    python -m problems.blind.ablation FOLDER [FOLDER ...] [--moved FACTOR [--seed N]]
    python scripts/blind.py --criteria moved.toml ...
"""

from __future__ import annotations

import argparse
import math
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any

import numpy as np

from casid.criterion import Criterion
from casid.diagnosis.cause import NOT_TRIED, Decision
from casid.diagnosis.comparisons import Gate, all_passed
from casid.diagnosis.criteria import Criteria
from problems.blind.table import markdown
from problems.campaign.store import read_results


@dataclass(frozen=True, kw_only=True)
class Use:
    """How often a criterion was asked, failed, was pivotal, and passed a gate as its alternative."""

    asked: Counter[str] = field(default_factory=Counter)
    failed: Counter[str] = field(default_factory=Counter)
    pivotal: Counter[str] = field(default_factory=Counter)
    sufficed: Counter[str] = field(default_factory=Counter)


def decisions_of(results: Mapping[str, Any]) -> Iterator[Decision]:
    """Every decision of a campaign's results."""
    for found in results.values():
        for entry in found.get("decisions", ()):
            yield Decision.from_dict(entry)


def use_of(decisions: Iterable[Decision]) -> Use:
    """The uses of every criterion in decisions."""
    use = Use()
    for one in decisions:
        for gate in one.gates:
            for asked in _with_alternatives(gate):
                use.asked[asked.criterion] += 1
            use.failed[gate.criterion] += not gate.passed
            if gate.passed and not gate.holds:
                use.sufficed[next(other.criterion for other in gate.or_else if other.passed)] += 1
        if len(one.failed) == 1:
            use.pivotal[one.failed[0].criterion] += 1
    return use


def _with_alternatives(gate: Gate) -> Iterator[Gate]:
    yield gate
    for other in gate.or_else:
        yield from _with_alternatives(other)


_UNMOVED = ("numerics.", "data.", "systems.")  # what takes time, and what other campaigns judge
Range = tuple[float, float]
# How a threshold follows from its criterion, and back. Otherwise it is a multiple, or the unit of the value.
_FORMS: tuple[tuple[Callable[[float], float], Callable[[float], float]], ...] = (
    (lambda criterion: criterion, lambda threshold: threshold),
    (lambda criterion: 1.0 / criterion, lambda threshold: 1.0 / threshold if threshold > 0.0 else math.inf),
    (lambda criterion: 1.0 - criterion, lambda threshold: 1.0 - threshold),
    (math.sqrt, lambda threshold: threshold * abs(threshold)),
)


def same_decisions(decisions: Iterable[Decision], criterion: str, now: float) -> Range:
    """The values of a criterion, `now` among them, between which every decision comes out as it did."""
    low, high = 0.0, math.inf
    for one in decisions:
        lower, upper = _same(one, criterion, now)
        low, high = max(low, lower), min(high, upper)
    return low, high


def _same(decision: Decision, criterion: str, now: float) -> Range:
    """The same for one decision: to the nearest values at which gates change and the decision with them."""
    asked = {_turns(gate, now) for gate in _all_gates(decision.gates) if gate.criterion == criterion}
    turns = sorted(at for at in asked if 0.0 < at < math.inf)
    outcome = all_passed(decision.gates)

    def changes(low: float, high: float) -> bool:
        between = 0.5 * (low + high) if high < math.inf else 2.0 * low
        return all_passed(_moved(gate, criterion, now, between) for gate in decision.gates) != outcome

    above, below = [at for at in turns if at >= now], [at for at in turns if at < now][::-1]
    higher = (a for a, b in pairwise([*above, math.inf]) if changes(a, b))
    lower = (a for a, b in pairwise([*below, 0.0]) if changes(b, a))
    return next(lower, 0.0), next(higher, math.inf)


def _all_gates(gates: Iterable[Gate]) -> Iterator[Gate]:
    for gate in gates:
        yield from _with_alternatives(gate)


def _form(gate: Gate, now: float) -> tuple[Callable[[float], float], Callable[[float], float]]:
    """How the threshold of a gate follows from its criterion, which is `now`."""
    for there, back in _FORMS:
        if math.isclose(there(now), gate.threshold, rel_tol=1e-9):
            return there, back
    unit = gate.threshold / now
    return lambda criterion: unit * criterion, lambda threshold: threshold / unit if unit else math.inf


def _turns(gate: Gate, now: float) -> float:
    """The value of its criterion at which a comparison turns."""
    return _form(gate, now)[1](gate.value)


def _moved(gate: Gate, criterion: str, now: float, value: float) -> Gate:
    """The gate, and its alternatives, with another value of a criterion."""
    others = tuple(_moved(other, criterion, now, value) for other in gate.or_else)
    threshold = _form(gate, now)[0](value) if gate.criterion == criterion else gate.threshold
    return replace(gate, threshold=threshold, or_else=others)


def rows(results: Mapping[str, Any]) -> list[dict[str, Any]]:
    """A row for each criterion that a gate names, the most decisive first; those of fitted causes apart from those of
    causes that were only screened."""
    every = list(decisions_of(results))
    apart = [[d for d in every if (d.outcome == NOT_TRIED) == untried] for untried in (False, True)]
    fitted, screened = map(use_of, apart)
    known = {one.name: one for one in Criteria().rows}
    names = sorted({*fitted.asked, *screened.asked} - {""})
    table = [
        {
            "criterion": name,
            "value": known[name].value if name in known else "",
            "evidence": known[name].evidence.partition(":")[0] if name in known else "",
            "asked of fitted causes": fitted.asked[name],
            "failed": fitted.failed[name],
            "alone decided": fitted.pivotal[name] + fitted.sufficed[name],
            "kept from a fit": screened.pivotal[name],
            "same decisions": _range_of(apart[0] if fitted.asked[name] else apart[1], known.get(name)),
        }
        for name in names
    ]
    return sorted(table, key=lambda row: (-row["alone decided"], -row["kept from a fit"], row["criterion"]))


def _range_of(decisions: Iterable[Decision], known: Criterion | None) -> str:
    """The range of a criterion in words; empty for one that is not known any more, or that is several values."""
    if known is None or isinstance(known.value, tuple):
        return ""
    low, high = same_decisions(decisions, known.name, known.value)
    return f"{low:.3g} to {high:.3g}" if high < math.inf else f"from {low:.3g}"


def moved(asked: Collection[str], factor: float, seed: int) -> str:
    """A TOML file in which the chosen numbers that are not `asked` by a gate are moved. Of a part above one half the
    odds are, and of a ratio just above one what exceeds it.
    """
    rng, lines = np.random.default_rng(seed), list[str]()
    for one in Criteria().rows:
        if one.name in asked or any(group in one.name for group in _UNMOVED) or not one.evidence.startswith("chosen"):
            continue
        if isinstance(one.value, float):
            lines.append(f"{one.name} = {_moved_by(one.value, factor if rng.random() < 0.5 else 1.0 / factor):.4g}")
    return "\n".join(lines)


def _moved_by(value: float, factor: float) -> float:
    if 0.5 < value < 1.0:
        return factor * value / (1.0 + (factor - 1.0) * value)
    return 1.0 + factor * (value - 1.0) if 1.0 < value < 2.0 else factor * value


def main() -> None:
    """Print the table of one or more campaign folders together, or a file of moved criteria."""
    parser = argparse.ArgumentParser(description="Which criteria decided anything?")
    parser.add_argument("folders", nargs="+", metavar="FOLDER", help="of campaigns")
    parser.add_argument("--moved", type=float, metavar="FACTOR", help="print criteria without a gate, moved by it")
    parser.add_argument("--seed", type=int, default=1, help="that says which are multiplied and which divided")
    given = parser.parse_args()
    results: dict[str, Any] = {}
    for folder in given.folders:
        results |= {f"{folder}/{name}": found for name, found in read_results(folder).items()}
    if given.moved:
        print(moved([row["criterion"] for row in rows(results)], given.moved, given.seed))
    else:
        print(f"{len(results)} sets\n\n{markdown(rows(results))}")


if __name__ == "__main__":
    main()
