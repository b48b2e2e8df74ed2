"""Figures of the studies of real aircraft, as files."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from casid.report.figure import Picture
from casid.report.svg import svg


def write_pictures(pictures: Iterable[Picture], folder: Path) -> list[Path]:
    """Write every picture as NAME.svg into `folder`, which is made; the paths."""
    folder.mkdir(parents=True, exist_ok=True)
    paths = []
    for picture in pictures:
        path = folder / f"{picture.name}.svg"
        path.write_bytes(svg(picture.figure))
        paths.append(path)
    return paths
