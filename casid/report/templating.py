"""Tables and figures of a page as data, and the Jinja2 templates that make HTML of them, with every value escaped."""

from __future__ import annotations

import base64
import gc
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined

from casid.errors import noting
from casid.frames import Rows
from casid.report import uplot
from casid.report.figure import Picture
from casid.report.svg import svg
from casid.report.words import pretty, probability_in_words


@dataclass(frozen=True, kw_only=True)
class Row:
    """A row of a table: `cells`, the first of which heads it; the anchor of the `claim` that it tells of, whose figures
    it links to; and whether it is `marked`."""

    cells: tuple[str, ...]
    claim: str = ""
    marked: bool = False


@dataclass(frozen=True, kw_only=True)
class ReportTable:
    """Rows under a `head`; `numeric`: short cells, none of which may break. A table without rows is not shown."""

    head: tuple[str, ...]
    rows: tuple[Row, ...]
    caption: str
    numeric: bool = False

    def text(self) -> str:
        """Return its rows for a terminal."""
        first, *rest = self.head
        rows = [row.cells for row in self.rows]
        return Rows(heads={first: "", **dict.fromkeys(rest, "s" if self.numeric else "")}, rows=rows).text()

    @property
    def kind(self) -> str:
        """Classes of the style sheet."""
        kinds = (("numeric", self.numeric), ("many", len(self.head) > 3), ("wide", len(self.head) > 5))
        return " ".join(word for word, true in kinds if true)


FIGURES = "report_figures"
# verdict -> colour of its badge
COLOURS: Mapping[str, str] = MappingProxyType(
    {
        "adequate": "#00694E",
        "values wrong": "#7A5B00",
        "explained": "#005A8F",
        "partly explained": "#A34700",
        "unexplained": "#9B2F6B",
        "data at fault": "#A3122A",
    }
)


@dataclass(frozen=True, kw_only=True)
class Figure:
    """A picture as a page shows it: its `number`, the SVG as `data`, and the claims that it shows, (anchor, head)."""

    number: int
    picture: Picture
    data: str
    claims: Sequence[tuple[str, str]] = field(default=())

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


def drawn_into(
    place: Path, shown: Mapping[str, Picture], failed: list[str] | None = None
) -> dict[str, tuple[Picture, bytes]]:
    """Name -> picture and its SVG; `place`, which is made, has these and no other SVG afterwards."""
    place.mkdir(parents=True, exist_ok=True)
    for old in place.glob("*.svg"):
        old.unlink()
    drawn: dict[str, tuple[Picture, bytes]] = {}
    with _collecting_seldom():
        for name, picture in shown.items():
            with noting(failed, name):
                drawn[name] = (picture, svg(picture.figure))
    for name, (_, text) in drawn.items():
        (place / f"{name}.svg").write_bytes(text)
    return drawn


def figures_of(
    drawn: Mapping[str, tuple[Picture, bytes]], claims: Mapping[str, Sequence[tuple[str, str]]]
) -> dict[str, Figure]:
    """Name -> figure, numbered in their order; `drawn` are pictures with their SVG, `claims` by name of figure."""
    return {
        name: Figure(
            number=number,
            picture=picture,
            data=base64.b64encode(text).decode("ascii"),
            claims=claims.get(name, ()),
        )
        for number, (name, (picture, text)) in enumerate(drawn.items(), 1)
    }


def write_page(folder: str | Path, name: str, pictures: Iterable[Picture], context: Mapping[str, Any]) -> None:
    """Write NAME.html from its template, whose `figures` these pictures are, and NAME_figures/*.svg into `folder`."""
    drawn = drawn_into(Path(folder) / f"{name}_figures", {picture.name: picture for picture in pictures})
    page = render(f"{name}.html", {"figures": list(figures_of(drawn, {}).values()), **context})
    (Path(folder) / f"{name}.html").write_text(page, encoding="utf-8")


def render(template: str, context: Mapping[str, Any]) -> str:
    """A page from a template of `casid/report/templates`. Whatever it is given is text: none of it becomes markup."""
    environment = Environment(
        loader=PackageLoader("casid.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {"pretty": pretty, "probability": probability_in_words}
    used: list[str] = []

    def curves(picture: Picture) -> str | None:
        told = uplot.curves(picture.figure)
        if told:
            used.append(picture.name)
        return told

    def drawing() -> dict[str, str] | None:
        return uplot.drawing() if used else None

    environment.globals |= {"curves": curves, "drawing": drawing}
    return environment.get_template(template).render(context)
