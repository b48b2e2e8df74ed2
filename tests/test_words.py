"""The words of the pages: every public name has an entry in the reference."""

from __future__ import annotations

from pathlib import Path

import casid

REPO = Path(__file__).resolve().parent.parent


def test_the_page_of_the_api_has_every_public_name() -> None:
    listed = set((REPO / "docs" / "api.md").read_text(encoding="utf-8").split())
    assert not set(casid.__all__) - {"__version__"} - listed
