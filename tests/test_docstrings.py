"""Docstrings of the public names are complete, and their examples run. Truth: signatures, and Python itself."""

from __future__ import annotations

import doctest
import inspect
import re
import tomllib
from collections.abc import Iterator
from pathlib import Path
from pkgutil import resolve_name
from types import FunctionType

import pytest
from numpydoc import validate

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
RULES = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["numpydoc_validation"]
# the example of the class uses its methods; annotations and the sentence say what they take and return
OF_MEMBERS = {"EX01", "PR01", "RT01"}
OF_THE_DIAGNOSIS = {"PR01", "PR02", "SS02"}  # one function for aircraft and systems takes any arguments
WITH_EXAMPLES = [name for name in casid.__all__ if ">>>" in (inspect.getdoc(getattr(casid, name)) or "")]
VARIADIC = (inspect.Parameter.VAR_POSITIONAL, inspect.Parameter.VAR_KEYWORD)


def sections(text: str) -> dict[str, str]:
    """Heading -> text of the sections of a docstring in numpydoc form."""
    parts = re.split(r"(?m)^([A-Z][a-z]+)\n-{3,}\n", text)
    return dict(zip(parts[1::2], parts[2::2], strict=True))


def example_of(name: str) -> str:
    """The example of a public name, behind the one that it goes on from."""
    text = sections(inspect.getdoc(getattr(casid, name)) or "").get("Examples", "")
    before = re.search(r"After the example of `(\w+)`", text)
    return (example_of(before[1]) + "\n\n" if before else "") + text


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


def public_objects() -> Iterator[tuple[str, bool]]:
    """(qualified name, whether it is a member of a class) of all exported names and their public members."""
    for name in sorted(set(casid.__all__) - {"__version__"}):
        one = getattr(casid, name)
        home = f"{one.__module__}.{one.__qualname__}"
        yield home, False
        if inspect.isclass(one):
            members = {key: value for key, value in vars(one).items() if not key.startswith("_")}
            kinds = (FunctionType, property, classmethod, staticmethod)
            yield from ((f"{home}.{key}", True) for key, value in members.items() if isinstance(value, kinds))


@pytest.mark.parametrize(("name", "is_member"), list(public_objects()))
def test_numpydoc_finds_nothing(name: str, is_member: bool) -> None:
    """The checks of [tool.numpydoc_validation]."""
    text = inspect.getdoc(resolve_name(name)) or ""
    left_out = OF_MEMBERS if is_member else set()
    if name.startswith("casid.diagnosis."):
        left_out = left_out | OF_THE_DIAGNOSIS
    for code in RULES["checks"]:
        if any(re.search(pattern, text) for pattern in RULES.get(f"override_{code}", ())):
            left_out = left_out | {code}
    wanted = set(RULES["checks"]) - left_out
    assert {code: message for code, message in validate.validate(name)["errors"] if code in wanted} == {}


@pytest.mark.parametrize("name", WITH_EXAMPLES)
def test_an_example_runs(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)  # examples name the files of the demonstration from there
    example = doctest.DocTestParser().get_doctest(example_of(name), {}, name, None, 0)
    said: list[str] = []
    assert doctest.DocTestRunner().run(example, out=said.append).failed == 0, "".join(said)
