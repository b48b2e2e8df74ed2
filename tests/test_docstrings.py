"""Docstrings of the public names are complete, and their examples run. Truth: signatures, and Python itself."""

from __future__ import annotations

import doctest
import inspect
import re
from pathlib import Path

import pytest

import casid

ROOT = Path(__file__).resolve().parents[1]
FUNCTIONS = [name for name in casid.__all__ if inspect.isfunction(getattr(casid, name))]
USED_MOST = (
    "Aircraft",
    "Fit",
    "GaussNewton",
    "InitialState",
    "Model",
    "MultipleShooting",
    "OutputError",
    "Problem",
    "Record",
    "SingleShooting",
)
WITH_EXAMPLES = [name for name in casid.__all__ if ">>>" in (inspect.getdoc(getattr(casid, name)) or "")]
VARIADIC = (inspect.Parameter.VAR_POSITIONAL, inspect.Parameter.VAR_KEYWORD)


def sections(text: str) -> dict[str, str]:
    """Heading -> text of the sections of a docstring in numpydoc form."""
    parts = re.split(r"(?m)^([A-Z][a-z]+)\n-{3,}\n", text)
    return dict(zip(parts[1::2], parts[2::2], strict=True))


def documented(section: str) -> set[str]:
    """Names of the entries of a section "Parameters"."""
    entries = re.findall(r"(?m)^(\w[\w, ]*?)(?: :.*)?$", section)
    return {name for entry in entries for name in entry.split(", ")}


@pytest.mark.parametrize("name", FUNCTIONS)
def test_a_function_says_what_it_takes_and_gives(name: str) -> None:
    signature = inspect.signature(getattr(casid, name))
    found = sections(inspect.getdoc(getattr(casid, name)) or "")
    takes = {p.name for p in signature.parameters.values() if p.kind not in VARIADIC}
    assert takes <= documented(found.get("Parameters", ""))
    assert signature.return_annotation in (None, "None") or {"Returns", "Yields"} & set(found)


@pytest.mark.parametrize("name", [*FUNCTIONS, *USED_MOST])
def test_a_name_that_is_used_first_has_an_example(name: str) -> None:
    assert ">>>" in sections(inspect.getdoc(getattr(casid, name)) or "").get("Examples", "")


@pytest.mark.parametrize("name", WITH_EXAMPLES)
def test_an_example_runs(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)  # examples name the files of the demonstration from there
    text = inspect.getdoc(getattr(casid, name)) or ""
    example = doctest.DocTestParser().get_doctest(text, {}, name, None, 0)
    said: list[str] = []
    assert doctest.DocTestRunner().run(example, out=said.append).failed == 0, "".join(said)
