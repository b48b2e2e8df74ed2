"""Tables of a blind campaign: what was reached, kind by kind, and detection power against size."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from statistics import median
from typing import Any

from casid.model.vocabulary import KINDS
from problems.blind.case import FAMILIES, OUTSIDE
from problems.blind.score import ELSEWHERE, FAILED, NOTHING, UNEXPLAINED, Score

_NO_NAME = (NOTHING, UNEXPLAINED, FAILED)


def group(score: Score) -> str:
    """The row of a set in the confusion matrix."""
    case = score.answer.case
    if case.startswith("one"):
        return score.answer.hidden[0].kind
    return case.split("-")[0] if case.startswith(("clean", "two")) else case


def rows() -> tuple[str, ...]:
    """Rows of the confusion matrix, in the order of the families; two effects at once have no place in it."""
    return ("clean", *(kind for kinds in FAMILIES.values() for kind in kinds), *OUTSIDE)


def confusion(scores: Iterable[Score]) -> dict[tuple[str, str], int]:
    """(row, column) -> number of sets; see `rows` and `columns`."""
    counts: dict[tuple[str, str], int] = {}
    for score in scores:
        cell = (group(score), score.named)
        counts[cell] = counts.get(cell, 0) + 1
    return counts


def columns() -> tuple[str, ...]:
    """Columns of the confusion matrix."""
    return (*(kind for kinds in FAMILIES.values() for kind in kinds), ELSEWHERE, *_NO_NAME)


def summary(scores: Sequence[Score]) -> list[tuple[str, str]]:
    """(what, measured) of one kind of sets, in the order of the requirements."""
    single = [s for s in scores if group(s) in KINDS]
    clean = [s for s in scores if group(s) == "clean"]
    outside = [s for s in scores if group(s) in OUTSIDE]
    two = [s for s in scores if group(s) == "two"]
    visible = [s for s in single if not s.answer.hidden[0].imitated]
    onsets = [s.onsets for s in scores if s.onsets[1]]
    sized = [s.sized for s in single if s.sized is not None]
    values = [s.values for s in scores]
    done = sorted(s.seconds for s in scores if s.verdict != FAILED)
    return [
        ("sets", str(len(scores))),
        ("one effect: first or in its set", _rate(single, lambda s: s.first)),
        ("one effect: family", _rate(single, lambda s: s.same_family)),
        ("the same, without mass, inertia, c.g. shifted in all records", _rate(visible, lambda s: s.first)),
        ("the same: family", _rate(visible, lambda s: s.same_family)),
        ("one effect: a further, wrong name besides", _rate(single, lambda s: s.first and s.wrong > 0)),
        ("one effect, but 'adequate'", _rate(single, lambda s: s.named == NOTHING)),
        ("one effect, but 'unexplained' with no name", _rate(single, lambda s: s.named == UNEXPLAINED)),
        ("one effect: a wrong name first", _rate(single, lambda s: s.named not in _NO_NAME and not s.first)),
        ("clean: sets with a name", _rate(clean, lambda s: s.wrong > 0)),
        ("clean: 'unexplained'", _rate(clean, lambda s: s.named == UNEXPLAINED)),
        ("outside the catalogue: a wrong name", _rate(outside, lambda s: s.wrong > 0 and not s.described)),
        ("outside the catalogue: said in other words", _rate(outside, lambda s: s.described)),
        ("outside the catalogue: 'adequate'", _rate(outside, lambda s: s.named == NOTHING)),
        ("two at once: both among the causes", _rate(two, lambda s: s.hits == 2)),
        ("two at once: one of them", _rate(two, lambda s: s.hits == 1)),
        ("two at once: a wrong name", _rate(two, lambda s: s.wrong > 0)),
        ("onset inside its interval", _part(sum(i for i, _ in onsets), sum(n for _, n in onsets))),
        ("size inside its 95 % interval", _part(sum(inside for _, inside in sized), len(sized))),
        ("size: median of the absolute error", f"{100 * median(abs(e) for e, _ in sized):.1f} %" if sized else "–"),
        ("contradicted values: truth inside the 95 % interval", _part(*map(sum, zip(*values, strict=True)))),
        ("failed", _rate(scores, lambda s: s.verdict == FAILED)),
        ("seconds per diagnosis: median, largest", f"{median(done):.1f}, {done[-1]:.1f}" if done else "–"),
    ]


def by_kind(scores: Sequence[Score]) -> list[dict[str, Any]]:
    """One line per row of the confusion matrix that has sets."""
    table = []
    for name in (*rows(), "two"):
        here = [s for s in scores if group(s) == name]
        if not here:
            continue
        sized = [s.sized for s in here if s.sized is not None and name in KINDS]
        elsewhere: dict[str, int] = {}
        for s in here:
            if not s.first:
                elsewhere[s.named] = elsewhere.get(s.named, 0) + 1
        words = ", ".join(f"{k} {n}" for k, n in sorted(elsewhere.items(), key=lambda item: -item[1]))
        table.append(
            {
                "case": name,
                "sets": len(here),
                "first": sum(s.first for s in here),
                "family": sum(s.same_family for s in here),
                "both": sum(s.hits == 2 for s in here) if name == "two" else "",
                "wrong names": sum(s.wrong for s in here),
                "size inside": f"{sum(inside for _, inside in sized)} of {len(sized)}" if sized else "",
                "onset inside": "{} of {}".format(*(sum(s.onsets[i] for s in here) for i in (0, 1)))
                if any(s.onsets[1] for s in here)
                else "",
                "instead": words,
            }
        )
    return table


def power(scores: Sequence[Score]) -> list[dict[str, Any]]:
    """Detection against size, in units of the size that an engineer would notice."""
    table = []
    for size in sorted({s.answer.size for s in scores}, reverse=True):
        here = [s for s in scores if group(s) in KINDS and s.answer.size == size]
        if here:
            table.append(
                {
                    "size": f"{size:g}",
                    "sets": len(here),
                    "first or in its set": sum(s.first for s in here),
                    "family": sum(s.same_family for s in here),
                    "wrong name first": sum(s.named not in _NO_NAME and not s.first for s in here),
                    "adequate": sum(s.named == NOTHING for s in here),
                    "unexplained": sum(s.named == UNEXPLAINED for s in here),
                }
            )
    return table


def markdown(table: Sequence[dict[str, Any]]) -> str:
    """A table in Markdown."""
    names = list(table[0])
    lines = ["| " + " | ".join(names) + " |", "|" + "---|" * len(names)]
    return "\n".join([*lines, *("| " + " | ".join(str(row[n]) for n in names) + " |" for row in table)])


def _rate(scores: Sequence[Score], is_so: Callable[[Score], bool]) -> str:
    return _part(sum(bool(is_so(s)) for s in scores), len(scores))


def _part(count: int, total: int) -> str:
    return f"{count} of {total} ({100 * count / total:.0f} %)" if total else "–"
