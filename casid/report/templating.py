"""Figures as a page numbers them, and the Jinja2 templates that make HTML of its parts, with every value escaped."""

from __future__ import annotations

import base64
import gc
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined

from casid.errors import noting
from casid.report import uplot
from casid.report.figure import Picture
from casid.report.sections import kind, rows_of
from casid.report.svg import svg
from casid.report.words import pretty, probability_in_words

# verdict -> colour of its badge
COLOURS: Mapping[str, str] = {
    "adequate": "#00694E",
    "values wrong": "#7A5B00",
    "explained": "#005A8F",
    "partly explained": "#A34700",
    "unexplained": "#9B2F6B",
    "data at fault": "#A3122A",
}


@dataclass(frozen=True, kw_only=True)
class Figure:
    """A picture as a page shows it: its `number`, and the SVG as `data`."""

    number: int
    picture: Picture
    data: str

    @property
    def anchor(self) -> str:
        """Target of a link to it."""
        return f"figure-{self.picture.name}"


@contextmanager
def _collecting_seldom() -> Iterator[None]:
    """Let the garbage of some figures lie: the collector would walk through it and all results again and again."""
    before = gc.get_threshold()
    gc.set_threshold(100_000)
    try:
        yield
    finally:
        gc.set_threshold(*before)


def drawn_into(place: Path, shown: Iterable[Picture], failed: list[str] | None = None) -> dict[str, Figure]:
    """Name -> figure, numbered in their order; `place`, which is made, has their SVG and no other one afterwards."""
    place.mkdir(parents=True, exist_ok=True)
    for old in place.glob("*.svg"):
        old.unlink()
    drawn: dict[str, Figure] = {}
    with _collecting_seldom():
        for picture in shown:
            with noting(failed, picture.name):
                text = svg(picture.figure)
                (place / f"{picture.name}.svg").write_bytes(text)
                data = base64.b64encode(text).decode("ascii")
                drawn[picture.name] = Figure(number=len(drawn) + 1, picture=picture, data=data)
    return drawn


def render(template: str, context: Mapping[str, Any]) -> str:
    """A page from a template of `casid/report/templates`. Whatever it is given is text: none of it becomes markup."""
    environment = Environment(
        loader=PackageLoader("casid.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {"pretty": pretty, "probability": probability_in_words, "kind": kind, "rows": rows_of}
    used: list[str] = []

    def curves(picture: Picture) -> str | None:
        told = uplot.curves(picture.figure) if picture.can_be_zoomed else None
        if told:
            used.append(picture.name)
        return told

    def drawing() -> dict[str, str] | None:
        return uplot.drawing() if used else None

    environment.globals |= {"curves": curves, "drawing": drawing}
    return environment.get_template(template).render(context)
