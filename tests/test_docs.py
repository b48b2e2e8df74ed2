"""Pages that are written from definitions are complete. Truth: the register of kinds."""

from __future__ import annotations

import glob
import importlib.util
import json
import re
import shlex
import shutil
from pathlib import Path
from types import ModuleType
from xml.etree import ElementTree

import pytest

from casid.cli.options import DEMO
from casid.model import causes  # noqa: F401  fills the register
from casid.model.aircraft import Aircraft
from casid.model.effect import KINDS
from problems.blind.case import OF_EQUATIONS, ROTORS, STATED

DOCS = Path(__file__).resolve().parents[1] / "docs"
NOT_DRAWN = {"table_increment", *ROTORS, *STATED, *OF_EQUATIONS}  # of tables, of rotors, of other models


@pytest.mark.parametrize("page", ["how-to", "kinds-of-model", "not-given", "systems"])
def test_code_of_a_page_runs_as_it_stands(page: str, capsys) -> None:
    """Of pages that say so. What the code prints is not judged, what it asserts is."""
    text = (DOCS / f"{page}.md").read_text(encoding="utf-8")
    blocks = re.findall(r"^```python\n(.*?)^```$", text, flags=re.MULTILINE | re.DOTALL)
    assert blocks
    exec(compile("\n".join(blocks), page, "exec"), {})
    assert re.search("converged|explained", capsys.readouterr().out)


def test_the_page_of_systems_has_every_kind_of_cause() -> None:
    table = re.findall(r"(?m)^\| .*", (DOCS / "systems.md").read_text(encoding="utf-8"))
    listed = set(re.findall(r"`(\w+)`", "\n".join(table)))
    assert listed == {name for name, kind in KINDS.items() if kind.of_systems}


@pytest.mark.slow
def test_commands_of_the_page_of_tasks_run(script_here, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In their order, on the records of the demonstration, whose elevator has a lag of 0.12 s. Status 1 is that of a
    proof of match that fails."""
    text = (DOCS / "how-to.md").read_text(encoding="utf-8")
    blocks = re.findall(r"^```sh\n(.*?)^```$", text.replace("\\\n", ""), re.M | re.S)
    lines = [line for block in blocks for line in block.splitlines()]
    assert lines
    (tmp_path / "flight").mkdir()
    for record in DEMO.glob("m*.csv"):
        shutil.copy(record, tmp_path / "flight")
    shutil.copy(DEMO / "aircraft.toml", tmp_path / "plane.toml")
    monkeypatch.chdir(tmp_path)
    for line in lines:
        name, *words = shlex.split(line)[1:]
        words = [one for word in words for one in (sorted(glob.glob(word)) or [word])]
        status, _, error = script_here(name, *words)
        assert status == 0 or (name, status) == ("match", 1), f"{line}: {error}"
    (lag,) = json.loads(Path("out/plane/diagnosis.json").read_text(encoding="utf-8"))["causes"]
    assert (lag["kind"], lag["target"]) == ("actuator_lag", "delta_e")
    assert abs(lag["value"] - 0.12) < 0.01


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


@pytest.mark.parametrize("page", ["criteria", "causes"])
def test_a_page_in_the_clone_is_that_of_its_definitions(monkeypatch: pytest.MonkeyPatch, page: str) -> None:
    monkeypatch.syspath_prepend(str(DOCS))  # the page's writer imports the equations beside it
    text = (DOCS / f"{page}.md").read_text(encoding="utf-8")
    assert text == getattr(load("written"), f"{page}_page")(), "run: python docs/written.py"


def test_the_page_of_causes_defines_each_of_them_once() -> None:
    text = (DOCS / "causes.md").read_text(encoding="utf-8")
    assert sorted(re.findall(r"^### `(\w+)`$", text, re.MULTILINE)) == sorted(KINDS)


def test_the_page_of_causes_has_the_sign_of_every_surface() -> None:
    """Truth: the derivatives of the demonstration, which has the usual signs, and moments by the right-hand rule."""
    text = (DOCS / "causes.md").read_text(encoding="utf-8")
    derivatives = Aircraft.read(DEMO / "aircraft.toml").derivatives
    turned = {
        "Cl": ("right wing down", "left wing down"),
        "Cm": ("nose up", "nose down"),
        "Cn": ("nose right", "nose left"),
    }
    rows = re.findall(r"^\| \w+ `(\w+)` \| .+? \| `(\w\w)_(\w+)` ([<>]) 0 \| (.+?) \|$", text, re.MULTILINE)
    assert {surface for surface, *_ in rows} == {"delta_e", "delta_a", "delta_r"}
    for surface, moment, by, relation, answer in rows:
        positive = derivatives[f"{moment}_{surface}"] > 0.0
        assert (by, relation, answer) == (surface, ">" if positive else "<", turned[moment][0 if positive else 1])


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


ROOT = DOCS.parent
# number of the demonstration or of the rates -> what it stands beside, on every page that has it
SAME = {
    "lag of the demonstration [s]": r"lag of\s+(0\.1\d*) s",
    "error as given": r"it\s+is\s+off\s+by\s+(\d+)\s+times\s+the\s+noise",
    "error that is left": r"(\d\.\d) times the[\s>]+noise is left",
    "statistic of the lag": r"lag has (\d{5})\b",
    "statistic of the delay": r"delay (\d{5})\b",
    "JSBSim, first": r"JSBSim\b[^.\n]*?(\d+ of 48)\b",
    "flights of others, first": r"(?:named first in|in\s+)(9) of 20|named first in (9)",
}


def test_the_front_page_is_short_and_has_what_a_newcomer_needs() -> None:
    """600 words at most; problem, picture, two commands, own data in five lines, rates, what it cannot see."""
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    assert len(text.split()) <= 600
    for asked in ("![", "casid demo", "casid diagnose", "docs/how-often.md", "cannot see"):
        assert asked in text
    own = re.search(r"five lines\n\n```\n(.*?)```", text, re.DOTALL)
    assert own is not None and len(own[1].splitlines()) == 5
    for page in re.findall(r"\]\((docs/[^)#]+)\)", text):
        assert (ROOT / page).is_file(), page


def test_files_that_pages_name_are_there() -> None:
    """Paths in code letters, links, and the table of the steps of a diagnosis. Built pages are not in the clone."""
    missing = []
    for page in [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted(DOCS.glob("*.md"))]:
        text = page.read_text(encoding="utf-8")
        named = re.findall(r"`((?:casid|scripts|problems|tests|docs|benchmarks)/[\w./*-]+)`", text)
        links = re.findall(r"\]\(([^)#:\s]+\.(?:md|png))", text)
        steps = re.search(r"## Where the code is\n(.*?)\n## ", text, re.DOTALL)
        own = re.findall(r"`((?!casid)[\w/]+(?:\.py|/))`", steps[1] if steps else "")
        for names, folder in ((named, ROOT), (links, page.parent), (own, ROOT / "casid" / "diagnosis")):
            kept = [name for name in names if "_build" not in name and not name.startswith("reference/")]
            missing += [(page.name, name) for name in kept if not any(folder.glob(name))]
    assert missing == []


@pytest.mark.parametrize("what", SAME)
def test_a_number_is_the_same_on_every_page(what: str) -> None:
    pages = [ROOT / "README.md", *sorted(DOCS.glob("*.md"))]
    found = {
        page.name: {next(filter(None, groups)) for groups in map(re.Match.groups, re.finditer(SAME[what], text))}
        for page in pages
        if re.search(SAME[what], text := page.read_text(encoding="utf-8"))
    }
    assert found, f"no page has the {what}: take it out of SAME"
    assert len(set().union(*found.values())) == 1, found


@pytest.mark.slow
def test_numbers_of_the_demonstration_are_those_that_it_gives(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Of the command that the pages follow, to the digits that they print; its sentences and gates word by word."""
    from casid.cli.diagnose import demo
    from casid.cli.why import why

    demo(out=tmp_path / "demo")
    told = json.loads((tmp_path / "demo" / "diagnosis.json").read_text(encoding="utf-8"))
    page = (DOCS / "diagnosis.md").read_text(encoding="utf-8")
    (lag,) = [one for one in told["causes"] if one["name"] == "actuator_lag(delta_e)"]
    said = re.search(r"The estimate of the lag is (\S+) s with a standard deviation of (\S+) s", page)
    assert said is not None
    assert (f"{lag['value']:.4f}", f"{lag['std']:.4f}") == said.groups()
    by_step = {one["step"]: one for one in told["account"]}
    for step, words in (("values", "re-estimated values"), ("structure", "added structure")):
        row = re.search(rf"\| {words}.*?\| (\S+) \| (\S+) \| (\S+) % \|", page)
        assert row is not None
        one = by_step[step]
        assert (f"{one['from']:.1f}", f"{one['to']:.1f}", f"{100 * one['share']:.0f}") == row.groups()
    quoted = re.search(r"(?:^> .*\n)+", page, re.MULTILINE)
    assert quoted is not None and " ".join(quoted[0].replace("\n> ", " ")[2:].split()) == told["sentence"]
    assert f"statistic in the final model is {lag['statistic']:.0f}." in page
    assert f"{len(told['decisions'])} decisions were recorded" in page
    rows = [(f"{one['statistic']:.0f}", f"{one['value']:.3f}") for one in told["ranking"][:5]]
    assert re.findall(r"^\| [a-z -]+ \| (\d{5,6}) \| (\S+) \S+ \|$", page, re.MULTILINE) == rows
    pages = page + (DOCS / "reading-a-verdict.md").read_text(encoding="utf-8")
    records = re.findall(r"^```(?:text)?\n((\w+\(\w+\)): \w+, round .*?)```", pages, re.MULTILINE | re.DOTALL)
    assert len(records) == 4
    for record, cause in records:
        capsys.readouterr()
        why(tmp_path / "demo", cause)
        assert record in capsys.readouterr().out, cause
