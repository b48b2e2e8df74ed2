"""The page of a command: what it prints, and its figures."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from casid.report.style import Picture
from casid.report.templating import drawn_into, figures_of, render


def write_result(folder: Path, name: str, title: str, said: object, pictures: Iterable[Picture]) -> None:
    """Write NAME.html with what the command prints, and `figures/*.svg`, into `folder`."""
    drawn = drawn_into(folder / "figures", {picture.name: picture for picture in pictures})
    context = {
        "colour": "#005A8F",
        "title": title,
        "said": str(said).strip("\n"),
        "figures": list(figures_of(drawn, {}).values()),
    }
    (folder / f"{name}.html").write_text(render("result.html", context), encoding="utf-8")
