"""Pages that are written from definitions are complete. Truth: the register of kinds."""

from __future__ import annotations

import importlib.util
import re
from pathlib import Path
from types import ModuleType
from xml.etree import ElementTree

import pytest

from casid.model import causes  # noqa: F401  fills the register
from casid.model.effect import KINDS
from problems.blind.case import ROTORS

DOCS = Path(__file__).resolve().parents[1] / "docs"
NOT_DRAWN = {"table_increment", *ROTORS}  # the Do 328 has no tables and no rotors


@pytest.mark.parametrize("page", ["how-to", "kinds-of-model"])
def test_code_of_a_page_runs_as_it_stands(page: str, capsys) -> None:
    """Of pages that say so. What the code prints is not judged, what it asserts is."""
    text = (DOCS / f"{page}.md").read_text(encoding="utf-8")
    blocks = re.findall(r"^```python\n(.*?)^```$", text, flags=re.MULTILINE | re.DOTALL)
    assert blocks
    exec(compile("\n".join(blocks), page, "exec"), {})
    assert "converged" in capsys.readouterr().out


def load(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(name, DOCS / f"{name}.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_every_cause_has_an_equation() -> None:
    equations = load("equations").EQUATIONS
    assert set(equations) == set(KINDS)
    assert all(formula.count("{") == formula.count("}") and "v" in formula for formula, _ in equations.values())


def test_every_cause_is_drawn_or_said_not_to_be() -> None:
    text = (DOCS / "written.py").read_text(encoding="utf-8")
    drawn = {kind for kind in KINDS if f'"{kind}": {{"target"' in text}
    assert drawn == set(KINDS) - NOT_DRAWN


def test_every_equation_becomes_mathml_whole() -> None:
    """No command of LaTeX is left over, and symbols are what they stand for. Truth: well-formed XML, a Greek letter."""
    pytest.importorskip("latex2mathml")
    from latex2mathml.converter import convert

    for kind, (formula, symbols) in load("equations").EQUATIONS.items():
        inline = re.findall(r"\$(.+?)\$", symbols)
        for latex in (formula, *inline):
            text = "".join(ElementTree.fromstring(convert(latex)).itertext())
            assert "\\" not in text, (kind, text)
    assert "δ" in "".join(ElementTree.fromstring(convert(r"\delta")).itertext())
