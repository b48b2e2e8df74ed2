"""Which criteria of the diagnosis decided anything on a campaign? Read from its decision traces.

A gate is pivotal when it is the only one of its decision that failed: without it the cause would have gone on. A
criterion that is never pivotal changed no decision of the campaign by itself.

    python -m problems.blind.ablation FOLDER [FOLDER ...]
"""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

from casid.diagnosis.cause import NOT_TRIED, Decision, Gate
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


def rows(results: Mapping[str, Any]) -> list[dict[str, Any]]:
    """A row for each criterion that a gate names, the most decisive first; those of fitted causes apart from those of
    causes that were only screened."""
    every = list(decisions_of(results))
    fitted, screened = (use_of(d for d in every if (d.outcome == NOT_TRIED) == untried) for untried in (False, True))
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
        }
        for name in names
    ]
    return sorted(table, key=lambda row: (-row["alone decided"], -row["kept from a fit"], row["criterion"]))


def main(folders: list[str]) -> None:
    """Print the table of one or more campaign folders together."""
    results: dict[str, Any] = {}
    for folder in folders:
        results |= {f"{folder}/{name}": found for name, found in read_results(folder).items()}
    print(f"{len(results)} sets\n\n{markdown(rows(results))}")


if __name__ == "__main__":
    main(sys.argv[1:])
