"""Table 5 as the paper printed it (Oezger, AIAA 2010-34), and the paper's four claims put to a table of this form."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from importlib.resources import files
from typing import Any

from problems.paper.cases import CASES
from problems.paper.statistics import DERIVATIVE_STATISTICS, MATCHES

EXACT = 1e-6
CONFIRMED, REFUTED = 0.9, 0.5  # share of cells that bear a claim out, from which and below which
ESTIMATORS = ("equation", "output", "combined")
_EQUATION_DOMAIN, _OUTPUT_DOMAIN = MATCHES[:3], MATCHES[3:]
WORDS = {
    1: "Linear and without noise (A, C) all three estimators are exact.",
    2: "Equation error matches best in the equation domain, output error in the output domain (linear aircraft), "
    "combined error always in between.",
    3: "Output error is closest to the true derivatives, and departs most.",
    4: "Nonlinear: combined error matches best in the output domain, and the equation part makes the iteration robust.",
}
Cells = Mapping[tuple[str, str, str], float]  # (case, estimator, statistic) -> value


@dataclass(frozen=True, kw_only=True)
class Part:
    """One countable statement of a claim: it holds in `holds` of `cells` cells of the table, the largest of which is
    `largest` where that is of interest."""

    words: str
    holds: int
    cells: int
    largest: float | None = None

    @property
    def answer(self) -> str:
        share = self.holds / self.cells if self.cells else float("nan")
        if not self.cells:
            return "not run"
        return "confirmed" if share >= CONFIRMED else "refuted" if share < REFUTED else "depends"


@dataclass(frozen=True, kw_only=True)
class Claim:
    """A claim of the paper, in words, and its parts as counted in one table."""

    number: int
    words: str
    parts: tuple[Part, ...]

    @property
    def answer(self) -> str:
        """confirmed or refuted when all its parts are; not run when none could be counted; depends otherwise."""
        answers = {part.answer for part in self.parts} - {"not run"}
        return answers.pop() if len(answers) == 1 else "depends" if answers else "not run"


def published() -> dict[tuple[str, str, str], float]:
    """(case, estimator, statistic) -> value of the paper."""
    text = files("problems.paper").joinpath("table5.csv").read_text(encoding="utf-8")
    rows = csv.DictReader(text.splitlines())
    return {(row["case"], row["estimator"], row["statistic"]): float(row["value"]) for row in rows}


def cells_of(rows: Iterable[Mapping[str, Any]], method: str) -> dict[tuple[str, str, str], float]:
    """The cells of one method of our own table."""
    return {(r["case"], r["estimator"], r["statistic"]): float(r["value"]) for r in rows if r["method"] == method}


def claims(cells: Cells) -> tuple[Claim, ...]:
    """The four claims, counted in a table; a cell that a part needs and that is not there is not counted."""
    linear, nonlinear = ("B", "D"), ("E", "F", "G", "H")
    both = {"B and D": linear, "E to H": nonlinear}
    every = (*_EQUATION_DOMAIN, *_OUTPUT_DOMAIN)
    derivatives = [name for name in DERIVATIVE_STATISTICS if not name.endswith("0")]
    exact = tuple(_exact(cells, estimator) for estimator in ESTIMATORS)
    domains = (
        *(_best(cells, "equation", c, _EQUATION_DOMAIN, f"equation domain, {where}") for where, c in both.items()),
        _best(cells, "output", linear, _OUTPUT_DOMAIN, "output domain, B and D"),
        *(_between(cells, c, every, f"both domains, {where}") for where, c in both.items()),
    )
    closest = (
        *(_best(cells, "output", c, derivatives, f"derivatives, {where}") for where, c in both.items()),
        _departs_most(cells),
    )
    robust = (
        _best(cells, "combined", nonlinear, _OUTPUT_DOMAIN, "output domain, E to H"),
        _fewer_departures(cells, nonlinear),
    )
    return tuple(Claim(number=n, words=WORDS[n], parts=p) for n, p in enumerate((exact, domains, closest, robust), 1))


def _exact(cells: Cells, estimator: str) -> Part:
    keys = [(c, estimator, s) for c in "AC" for s in DERIVATIVE_STATISTICS if _ran(cells, c)]
    good = sum(key in cells and cells[key] < EXACT for key in keys)
    found = [cells[key] for key in keys if key in cells]
    words = f"{estimator} error: derivative errors below {EXACT:g}"
    return Part(words=words, holds=good, cells=len(keys), largest=max(found, default=None))


def _ran(cells: Cells, case: str) -> bool:
    return any(key[0] == case for key in cells)


def _triples(cells: Cells, cases: Iterable[str], names: Iterable[str]) -> Iterator[tuple[float, float, float]]:
    names = tuple(names)
    for case in cases:
        for name in names:
            keys = [(case, estimator, name) for estimator in ESTIMATORS]
            if all(key in cells for key in keys):
                equation, output, combined = (cells[key] for key in keys)
                yield equation, output, combined


def _best(cells: Cells, estimator: str, cases: Iterable[str], names: Iterable[str], where: str) -> Part:
    """Ties count as best: the printed table has few digits."""
    at = ESTIMATORS.index(estimator)
    found = [triple[at] <= min(triple) for triple in _triples(cells, cases, names)]
    return Part(words=f"{estimator} error is the best of three ({where})", holds=sum(found), cells=len(found))


def _between(cells: Cells, cases: Iterable[str], names: Iterable[str], where: str) -> Part:
    found = [min(e, o) <= c <= max(e, o) for e, o, c in _triples(cells, cases, names)]
    words = f"combined error lies between equation and output error ({where})"
    return Part(words=words, holds=sum(found), cells=len(found))


def _departures(cells: Cells, case: str) -> dict[str, float]:
    return {e: v for (c, e, s), v in cells.items() if c == case and s.startswith("departures_of_")}


def _departs_most(cells: Cells) -> Part:
    counts = [d for case in CASES if len(d := _departures(cells, case)) == len(ESTIMATORS) and any(d.values())]
    found = [d["output"] > max(d["equation"], d["combined"]) for d in counts]
    return Part(words="output error departs most (cases with departures)", holds=sum(found), cells=len(found))


def _fewer_departures(cells: Cells, cases: Iterable[str]) -> Part:
    counts = [d for case in cases if len(d := _departures(cells, case)) == len(ESTIMATORS) and d["output"]]
    found = [d["combined"] < d["output"] for d in counts]
    words = "combined error departs less than output error (nonlinear cases in which that departs)"
    return Part(words=words, holds=sum(found), cells=len(found))
