"""A table of a page, as plain text: the templates make HTML of it."""

from __future__ import annotations

from dataclasses import dataclass


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

    @property
    def kind(self) -> str:
        """Classes of the style sheet."""
        kinds = (("numeric", self.numeric), ("many", len(self.head) > 3), ("wide", len(self.head) > 6))
        return " ".join(word for word, true in kinds if true)
