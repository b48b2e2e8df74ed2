"""Every script of an experiment says how it is used, and is in the list of experiments."""

from __future__ import annotations

from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
SCRIPTS = sorted(path.name for path in (ROOT / "scripts").glob("*.py") if path.name != "__init__.py")


@pytest.mark.parametrize("name", SCRIPTS)
def test_a_script_has_an_example_in_its_help_and_a_line_on_the_page(name: str) -> None:
    source = (ROOT / "scripts" / name).read_text(encoding="utf-8")
    assert f"Example: python scripts/{name}" in source, "epilog of its --help"
    assert f"`scripts/{name}`" in (ROOT / "docs" / "how-often.md").read_text(encoding="utf-8")
