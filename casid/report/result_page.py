"""The page of a command: its answer, what to do next, its figures, and what it prints."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import dataclass
from pathlib import Path

from casid.diagnosis.document import NextStep
from casid.report.figure import Picture
from casid.report.templating import ReportTable, drawn_into, figures_of, render

GOOD = "#00694E"
BAD = "#A3122A"
NEUTRAL = "#005A8F"


@dataclass(frozen=True, kw_only=True)
class Answer:
    """Beginning of a page: a sentence under a badge, its reasons, and what to do next."""

    badge: str
    sentence: str
    points: tuple[str, ...] = ()
    next: tuple[NextStep, ...] = ()
    colour: str = NEUTRAL

    def __str__(self) -> str:
        lines = [f"{self.badge.lower()}: {self.sentence}", *(f"  - {one}" for one in self.points)]
        return "\n".join([*lines, *map(str, self.next)])


@dataclass(frozen=True, kw_only=True)
class Bar:
    """A bar of a row: its number in words, and its width in per cent of the row."""

    text: str
    width: float


@dataclass(frozen=True, kw_only=True)
class Bars:
    """Rows of bars, one for each of `names`, on a common scale."""

    caption: str
    names: tuple[str, ...]
    rows: tuple[tuple[str, tuple[Bar, ...]], ...]


def write_result(
    folder: Path,
    name: str,
    title: str,
    answer: Answer,
    said: object,
    pictures: Iterable[Picture],
    *,
    folded: Collection[str] = (),
    tables: Iterable[ReportTable] = (),
    bars: Bars | None = None,
) -> None:
    """Write NAME.html and `figures/*.svg` into `folder`.

    The page has the answer, `bars`, `tables`, the pictures, those `folded` by name below, and what the command prints.
    """
    drawn = drawn_into(folder / "figures", {picture.name: picture for picture in pictures})
    figures = figures_of(drawn, {})
    context = {
        "colour": answer.colour,
        "title": title,
        "answer": answer,
        "said": str(said).strip("\n"),
        "figures": [one for key, one in figures.items() if key not in folded],
        "tables": list(tables),
        "bars": bars,
        "folded": [one for key, one in figures.items() if key in folded],
    }
    (folder / f"{name}.html").write_text(render("result.html", context), encoding="utf-8")
