"""The page of a command: its answer, what to do next, its figures, and what it prints."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from casid.diagnosis.document import NextStep
from casid.report.sections import Section, pictures_of, shown_parts
from casid.report.templating import drawn_into, render

GOOD = "#00694E"
BAD = "#A3122A"
NEUTRAL = "#005A8F"


@dataclass(frozen=True, kw_only=True)
class Answer:
    """Beginning of a page: a sentence under a badge, "" for none, its reasons, and what to do next."""

    badge: str
    sentence: str
    points: tuple[str, ...] = ()
    next: tuple[NextStep, ...] = ()
    colour: str = NEUTRAL

    def __str__(self) -> str:
        lines = [f"{self.badge.lower()}: {self.sentence}", *(f"  - {one}" for one in self.points)]
        return "\n".join([*lines, *map(str, self.next)])


def answer_of_faults(badge: str, faults: Sequence[str], none: str, points: Iterable[str] = ()) -> Answer:
    """Return the beginning of a page that says what is wrong, or `none`; in red and in green."""
    several = f"{len(faults)} faults were found:"
    return Answer(
        badge=badge,
        sentence=several if len(faults) > 1 else faults[0] if faults else none,
        points=(*(faults if len(faults) > 1 else ()), *points),
        colour=BAD if faults else GOOD,
    )


def in_numbers(said: object, open: bool = True) -> Section:
    """Return the section with what the command prints."""
    return Section(title="In numbers", parts=(str(said).strip("\n"),), open=open)


def write_result(
    folder: str | Path, name: str, title: str, answer: Answer, parts: Iterable[Any], figures: str = "figures"
) -> None:
    """Write the page NAME.html, which has the answer and `parts`, and `figures`/*.svg into `folder`, which is made."""
    shown = shown_parts(parts)
    drawn = drawn_into(Path(folder) / figures, pictures_of(shown))
    context = {"name": name, "title": title, "colour": answer.colour, "answer": answer, "parts": shown}
    context |= {"figures": drawn, "claim_of": {}, "shows": {}}
    (Path(folder) / f"{name}.html").write_text(render("result.html", context), encoding="utf-8")
