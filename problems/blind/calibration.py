"""Whether stated probabilities can be trusted: reliability by bins, and the log score, of sets with sealed answers."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from casid.model.vocabulary import KINDS
from problems.blind.case import Answer
from problems.blind.score import same

BINS = (0.0, 0.1, 0.5, 0.9, 0.99, 1.0)
_FLOOR = 1e-4  # below which the document does not tell a probability


@dataclass(frozen=True, kw_only=True)
class Stated:
    """A probability that was stated of a cause, and whether it was hidden there."""

    probability: float
    true: bool


def stated(answer: Answer, found: Mapping[str, Any]) -> list[Stated]:
    """Every cause of a set that had a probability; every hidden one of the catalogue that had none, at the floor."""
    believed = {name: float(p) for name, p in found.get("believed", {}).items()}
    right = {name: any(same(one, parsed(name)) for one in answer.hidden) for name in believed}
    pairs = [Stated(probability=p, true=right[name]) for name, p in believed.items()]
    nameable = [one for one in answer.hidden if one.kind in KINDS]
    told = sum(any(same(one, parsed(name)) for name in believed) for one in nameable)
    return pairs + [Stated(probability=_FLOOR, true=True)] * (len(nameable) - told)


def parsed(name: str) -> dict[str, str | None]:
    """The cause of which `name` is the parameter, like `aero_term(CL:alpha^2)`."""
    kind, inside = re.fullmatch(r"(\w+)(?:\((.*)\))?", name).groups()  # type: ignore[union-attr]
    target, _, term = (inside or "").split(", ")[0].partition(":")
    return {"kind": kind, "target": target, "term": term or None}


def log_score(pairs: Iterable[Stated]) -> float:
    """Sum of the logarithms of what was stated of what is, nats; 0 is perfect."""
    total = 0.0
    for one in pairs:
        p = float(np.clip(one.probability, _FLOOR, 1.0 - _FLOOR))
        total += float(np.log(p if one.true else 1.0 - p))
    return total


def reliability(pairs: Sequence[Stated]) -> list[dict[str, Any]]:
    """By bins of the stated probability: how many causes, what was stated of them on average, how many were there."""
    rows = []
    for low, high in zip(BINS[:-1], BINS[1:], strict=True):
        inside = [one for one in pairs if low <= one.probability < high or (high == 1.0 and one.probability >= low)]
        if not inside:
            continue
        rows.append(
            {
                "stated": f"{low:g} to {high:g}",
                "causes": len(inside),
                "mean stated": f"{np.mean([one.probability for one in inside]):.3f}",
                "hidden": f"{np.mean([one.true for one in inside]):.3f}",
            }
        )
    return rows
