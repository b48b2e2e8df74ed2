"""The house rules that a machine can hold: the way of imports, one statement a line, what `import casid` costs.

The truth is the map in CONTRIBUTING.md, written down here once more as LAYERS.
"""

from __future__ import annotations

import ast
import graphlib
import importlib
import inspect
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

import casid
from casid.above import DONE_BY

REPO = Path(__file__).resolve().parent.parent
HOUSE = ("casid", "problems", "scripts", "benchmarks")
MAX_PAIRS = 150  # assignments of two names in one line
MAX_ARGUMENTS = 7  # of a function, see `arguments_of`

# room -> the rooms it may import from, besides itself. "casid" is the package's front door, casid/__init__.py.
_CORE = {"errors", "arguments", "signals", "keeping", "criterion", "frames", "above"}
_DATA = _CORE | {"native", "records"}
_MODEL = _DATA | {"model"}
_ENGINE = _MODEL | {"estimation", "filtering", "analysis", "design"}
_STANDARDS = {"frequency", "acceptance"}
_USERS = _ENGINE | _STANDARDS | {"diagnosis", "data_check", "report", "formats", "cli", "casid"}
LAYERS: dict[str, set[str]] = {
    "errors": set(),
    "arguments": {"errors"},
    "keeping": {"errors", "arguments"},
    "signals": {"errors"},
    "criterion": {"errors"},
    "frames": {"errors"},
    "above": set(),
    "native": {"errors"},
    "records": _CORE,
    "model": _DATA,
    "formats": _MODEL | {"estimation"},
    "estimation": _MODEL,
    "filtering": _MODEL | {"estimation"},
    "analysis": _MODEL | {"estimation", "filtering"},
    "design": _MODEL | {"estimation", "filtering"},
    "data_check": _MODEL,
    "diagnosis": _ENGINE | {"data_check", "frequency"},
    "frequency": _ENGINE,
    "acceptance": _ENGINE | {"frequency", "diagnosis"},
    "report": _ENGINE | _STANDARDS | {"diagnosis", "data_check"},
    "cli": _ENGINE | _STANDARDS | {"diagnosis", "data_check", "report", "formats"},
    "casid": _USERS - {"casid"},
    "__main__": {"cli"},
    "problems": _USERS,
    "scripts": _USERS | {"problems"},
    "benchmarks": _USERS | {"problems"},
}


def room_of_file(path: Path) -> str:
    """casid/records/record.py -> records; casid/errors.py -> errors; casid/__init__.py -> casid."""
    parts = path.relative_to(REPO).with_suffix("").parts
    if parts[0] != "casid":
        return parts[0]
    return "casid" if parts[1] == "__init__" else parts[1]


def room_of_module(module: str) -> str | None:
    """casid.records.record -> records; casid -> casid; numpy -> None."""
    head, *rest = module.split(".")
    if head == "casid" and rest:
        return rest[0]
    return head if head in HOUSE else None


def imported_modules(source: str, package: str = "") -> Iterator[tuple[int, str]]:
    """(line, absolute module) of every import in `source`, also inside functions; `package` resolves relative ones.

    `from casid import errors` is casid.errors, `from casid import Problem` is casid: a name counts as a
    module when there is such a file or folder.
    """
    yield from imports_in(ast.parse(source), package)


def imports_in(tree: ast.Module, package: str) -> Iterator[tuple[int, str]]:
    """Of a tree."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from ((node.lineno, alias.name) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                above = package.split(".")[: len(package.split(".")) - node.level + 1]
                base = ".".join([*above, base] if base else above)
            for alias in node.names:
                inside = REPO.joinpath(*base.split("."), alias.name)
                is_module = inside.is_dir() or inside.with_suffix(".py").is_file()
                yield node.lineno, f"{base}.{alias.name}" if is_module else base


def sources(*folders: str) -> list[Path]:
    return sorted(path for folder in folders for path in (REPO / folder).rglob("*.py"))


@cache
def tree_of(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


@cache
def imports_of(path: Path) -> tuple[tuple[int, str], ...]:
    return tuple(imports_in(tree_of(path), ".".join(path.relative_to(REPO).parent.parts)))


def test_layers_have_no_circle() -> None:
    """Whatever LAYERS comes to say, no room may import itself around a corner."""
    tuple(graphlib.TopologicalSorter(LAYERS).static_order())  # raises CycleError


def test_imports_point_down() -> None:
    """What stands in no room may import nothing."""
    wrong = [
        f"{path.relative_to(REPO)}:{line} imports {module}, and {room} may import {sorted(LAYERS.get(room, ()))} only"
        for path in sources(*HOUSE)
        for room in [room_of_file(path)]
        for line, module in imports_of(path)
        if (target := room_of_module(module)) is not None and target != room and target not in LAYERS.get(room, ())
    ]
    assert not wrong
    assert {room_of_file(path) for path in sources(*HOUSE)} == set(LAYERS)


def test_no_file_imports_itself_around_a_corner() -> None:
    """Files by what they import: at the top, late, or for type checkers alone. Finer than the rooms above."""
    graph: dict[str, set[str]] = {}
    for path in sources("casid", "problems"):
        name = ".".join(path.relative_to(REPO).with_suffix("").parts).removesuffix(".__init__")
        graph[name] = {module for _, module in imports_of(path)} - {name}
    own = {name: {module for module in wanted if module in graph} for name, wanted in graph.items()}
    assert any(own.values())
    tuple(graphlib.TopologicalSorter(own).static_order())  # raises CycleError


@pytest.mark.parametrize(
    ("source", "package", "expected"),
    [
        ("import casid.model.system as s", "casid.records", "casid.model.system"),
        ("from casid import errors", "casid.records", "casid.errors"),
        ("from casid import Problem", "casid.records", "casid"),
        ("from casid.errors import InputError", "casid.records", "casid.errors"),
        ("from . import record", "casid.records", "casid.records.record"),
        ("from .record import Record", "casid.records", "casid.records.record"),
        ("from ..model.system import Model", "casid.records", "casid.model.system"),
        ("def late():\n    import matplotlib.pyplot as plt", "casid.records", "matplotlib.pyplot"),
    ],
)
def test_every_form_of_import_is_seen(source: str, package: str, expected: str) -> None:
    """The rules above hold only if no spelling of an import escapes them (forms of the Python reference, 7.11)."""
    assert [module for _, module in imported_modules(source, package)] == [expected]


def test_modules_are_imported_by_name_by_the_front_door_the_way_up_and_for_extras() -> None:
    files = (path for path in sources("casid") if "import_module(" in path.read_text(encoding="utf-8"))
    assert {str(path.relative_to(REPO)) for path in files} == {
        "casid/__init__.py",
        "casid/above.py",
        "casid/records/foreign.py",
    }


def test_what_is_asked_of_rooms_above_is_there_and_takes_what_it_is_given() -> None:
    """Every call of `ask_above` has a line in the table and every line a call; the function has so many arguments."""
    asked = dict[str, int]()
    for path in sources("casid"):
        for node in ast.walk(tree_of(path)):
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "ask_above":
                name, *given = node.args
                asked[ast.literal_eval(name)] = len(given)
    assert asked.keys() == DONE_BY.keys()
    for name, count in asked.items():
        module, _, function = DONE_BY[name].rpartition(".")
        inspect.signature(getattr(importlib.import_module(module), function)).bind(*range(count))


def test_matplotlib_stays_in_the_report() -> None:
    wrong = [
        f"{path.relative_to(REPO)}:{line}"
        for path in sources("casid", "scripts", "benchmarks")
        for line, module in imports_of(path)
        if module.split(".")[0] == "matplotlib" and room_of_file(path) != "report"
    ]
    assert not wrong


_COMPUTES = {"estimation", "filtering", "analysis", "design", "diagnosis", "frequency", "data_check"}
_UNITS = {"gain_db", "phase_deg"}  # a number in another unit
_FITS = {"flight", "evidence", "engine", "shown", "last_tests", "causes", "diagnose"}  # parts of the diagnosis


def test_the_report_draws_and_fits_nothing() -> None:
    """It takes results, whose classes and constants it may name, and calls no function of a room that computes."""
    wrong = [
        f"{path.relative_to(REPO)}:{node.lineno} {alias.name}"
        for path in sources("casid/report")
        for node in ast.walk(tree_of(path))
        if isinstance(node, ast.ImportFrom) and room_of_module(node.module or "") in _COMPUTES
        for alias in node.names
        if alias.name.islower() and alias.name not in _UNITS
    ]
    fits = [
        f"{path.relative_to(REPO)}:{line} {module}"
        for path in sources("casid/report")
        for line, module in imports_of(path)
        if module.split(".")[1:2] == ["diagnosis"] and module.split(".")[2] in _FITS
    ]
    assert not wrong and not fits


def test_gates_are_made_in_one_file() -> None:
    """What a cause was asked is read in `casid/diagnosis/comparisons.py`."""
    found = {
        str(path.relative_to(REPO))
        for path in sources("casid")
        for node in ast.walk(tree_of(path))
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "Gate"
    }
    assert found == {"casid/diagnosis/comparisons.py"}


# who minimises anything by scipy, and why it is no fit of a problem
MINIMISERS = {
    "casid/estimation/population.py": "the spread over records, whose likelihood is that of whole fits",
    "casid/filtering/likelihood.py": "levels of noise at one linearisation, parameters at their optimum for each",
    "casid/filtering/colour.py": "one correlation time of a series",
}


def test_one_loop_makes_the_steps_of_every_fit() -> None:
    """Searches of the engine are driven by `iteration.py`; the parameters' step within limits is solved for the two
    kinds of objective, their path limits, and Newton's reduced problem. Other minimisers are named with a reason."""
    rooms = sources("casid/estimation", "casid/filtering", "casid/analysis")
    calls = [
        (str(path.relative_to(REPO)), ast.unparse(node.func))
        for path in rooms
        for node in ast.walk(tree_of(path))
        if isinstance(node, ast.Call)
    ]
    solvers = "casid/estimation/solvers"
    assert {path for path, call in calls if call.endswith(".advance")} == {f"{solvers}/iteration.py"}
    steps = {path for path, call in calls if call == "parameter_step"}
    assert steps == {f"{solvers}/{name}.py" for name in ("objective", "own", "paths", "newton")}
    assert {path for path, call in calls if call.startswith("scipy.optimize.")} == set(MINIMISERS)


def test_casid_needs_only_its_declared_dependencies() -> None:
    """At module level casid imports the standard library and [project.dependencies]; extras wait inside functions."""
    project = tomllib.loads((REPO / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    declared = {requirement.split(">")[0] for requirement in project["dependencies"]}
    allowed = declared | {"casid"} | set(sys.stdlib_module_names)
    wrong = []
    for path in sources("casid"):
        for node in tree_of(path).body:
            modules = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            if isinstance(node, ast.ImportFrom) and node.level == 0:
                modules = [str(node.module)]
            wrong += [f"{path.relative_to(REPO)}:{node.lineno} {m}" for m in modules if m.split(".")[0] not in allowed]
    assert not wrong


Function = ast.FunctionDef | ast.AsyncFunctionDef


@cache
def functions_of(path: Path) -> tuple[Function, ...]:
    return tuple(node for node in ast.walk(tree_of(path)) if isinstance(node, Function))


def functions(*folders: str) -> Iterator[tuple[str, Function]]:
    """(file and line, definition) of every function and method."""
    for path in sources(*folders):
        for node in functions_of(path):
            yield f"{path.relative_to(REPO)}:{node.lineno} {node.name}", node


def arguments_of(function: Function) -> int:
    """How many arguments a caller must know: `self` and `cls` are given by Python; an option, which is keyword-only
    with a default, is named where it is given and left away elsewhere."""
    given = function.args
    by_place = [one.arg for one in (*given.posonlyargs, *given.args)]
    by_place = by_place[1:] if by_place[:1] in (["self"], ["cls"]) else by_place
    return len(by_place) + sum(default is None for default in given.kw_defaults)


def test_arguments_that_belong_together_have_a_type() -> None:
    wide = functions(*HOUSE, "tests")
    assert not [where for where, one in wide if arguments_of(one) > MAX_ARGUMENTS]


def test_arguments_are_counted() -> None:
    source = 'class A:\n    def f(self, a, b=1, *c, d, e=2):\n        """One.\n\n        Two."""\n        return a\n'
    (method,) = [node for node in ast.walk(ast.parse(source)) if isinstance(node, Function)]
    assert arguments_of(method) == 3


def test_a_line_has_one_assignment() -> None:
    """`a, b = x, y` stays where the values are exchanged or unpacked together."""
    found = [
        f"{path.relative_to(REPO)}:{node.lineno}"
        for path in sources("casid")
        for node in ast.walk(tree_of(path))
        if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Tuple) and isinstance(node.value, ast.Tuple)
    ]
    assert len(found) <= MAX_PAIRS


def test_no_line_is_kept_from_the_formatter() -> None:
    mark = "# fmt" + ":"
    found = [path for path in sources(*HOUSE, "tests") if mark in path.read_text("utf-8")]
    assert not found


def test_numbers_of_the_diagnosis_stand_among_its_criteria() -> None:
    """No file names a number at its top, not even in a table: as a field of a group it has a meaning and evidence."""
    found = []
    for path in sources("casid/diagnosis"):
        for node in tree_of(path).body:
            if isinstance(node, ast.Assign | ast.AnnAssign) and node.value is not None:
                inside = (one.value for one in ast.walk(node.value) if isinstance(one, ast.Constant))
                if any(type(value) in (int, float) for value in inside):
                    found.append(f"{path.relative_to(REPO)}:{node.lineno}")
    assert not found


def test_import_casid_is_light_and_leaves_the_environment_alone() -> None:
    """A fresh interpreter that imports casid has loaded no library that takes time, and changed no variable."""
    heavy = "{'numpy', 'casadi', 'scipy', 'matplotlib', 'rich', 'threadpoolctl'}"
    code = f"import os; b = dict(os.environ); import sys, casid; print(*({heavy} & set(sys.modules)), b == os.environ)"
    process = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=REPO)
    assert process.stdout.split() == ["True"]


def test_public_names_have_types_and_exist() -> None:
    """casid/__init__.pyi, which type checkers read, imports every public name from where it lives, and no other."""
    typed = ast.parse((REPO / "casid" / "__init__.pyi").read_text(encoding="utf-8")).body
    imports = [node for node in typed if isinstance(node, ast.ImportFrom)]
    homes = {alias.name: str(node.module) for node in imports for alias in node.names}
    assert sorted(casid.__all__) == sorted(["__version__", *homes])
    for name, home in homes.items():
        assert getattr(casid, name) is getattr(importlib.import_module(home), name), name
    listed = next(node.value for node in typed if isinstance(node, ast.Assign))
    assert ast.literal_eval(listed) == casid.__all__


def endless(source: str) -> Iterator[int]:
    """Return the lines of loops whose condition is a constant."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.While) and isinstance(node.test, ast.Constant):
            yield node.lineno


def test_no_loop_is_without_a_bound() -> None:
    """A loop ends by a count or a condition, which stands in its first line."""
    assert list(endless("while True:\n    pass\nwhile k < 3:\n    k += 1\n")) == [1]
    wrong = [
        f"{path.relative_to(REPO)}:{line}" for path in sources("casid") for line in endless(path.read_text("utf-8"))
    ]
    assert not wrong, wrong
