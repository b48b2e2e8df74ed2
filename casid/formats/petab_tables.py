"""The files of a PEtab problem (version 1): rows of its tables, and its model."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from itertools import zip_longest
from pathlib import Path
from typing import Any

from casid.arguments import a_path, given
from casid.errors import InputError, check_known
from casid.formats.sbml import SbmlModel, read_sbml
from casid.records.limits import read_bytes, read_text_of

Row = Mapping[str, str]


@dataclass(frozen=True, eq=False, kw_only=True)
class Tables:
    """The files of a problem: rows by table, and the model."""

    file: Path
    sbml: SbmlModel
    conditions: list[Row]
    observables: list[Row]
    measurements: list[Row]
    parameters: list[Row]

    @classmethod
    def read(cls, file: Path) -> Tables:
        """All files that the YAML file names."""
        content = _content(file)
        problems = content.get("problems")
        if not isinstance(problems, list) or len(problems) != 1 or not isinstance(problems[0], dict):
            raise InputError(f"{file}: 'problems' is {given(problems):.80}; expected a list of one problem of PEtab 1")
        one = problems[0]
        check_known("key", map(str, content), _KEYS, str(file))
        check_known("key of a problem", map(str, one), _KEYS_OF_PROBLEM, str(file))
        models = _named(file, one, "sbml_files")
        if len(models) != 1:
            raise InputError(f"{file}: 'sbml_files' names {len(models)} files; expected one")
        kinds = {
            "conditions": _named(file, one, "condition_files"),
            "observables": _named(file, one, "observable_files"),
            "measurements": _named(file, one, "measurement_files"),
            "parameters": _named(file, content, "parameter_file"),
        }
        rows = {kind: [r for path in paths for r in _rows(path, _COLUMNS[kind])] for kind, paths in kinds.items()}
        for kind, columns in _COLUMNS.items():
            if kind != "measurements":
                _check_unique(kinds[kind], columns[0], rows[kind])
        return cls(file=file, sbml=read_sbml(models[0]), **rows)


# of each table; the first names its rows
_COLUMNS = {
    "conditions": ("conditionId",),
    "observables": ("observableId", "observableFormula", "noiseFormula"),
    "measurements": ("observableId", "simulationConditionId", "measurement", "time"),
    "parameters": ("parameterId", "nominalValue"),
}


_OPTIONAL = ("parameterName", "parameterScale", "lowerBound", "upperBound", "estimate", "objectivePriorType")
_OPTIONAL += ("objectivePriorParameters", "initializationPriorType", "initializationPriorParameters", "observableName")
_OPTIONAL += ("observableTransformation", "noiseDistribution", "preequilibrationConditionId", "observableParameters")
_OPTIONAL += ("noiseParameters", "conditionName", "datasetId", "replicateId")
_CLOSE = 0.8
_KEYS = ("format_version", "parameter_file", "problems", "extensions")
_KEYS_OF_PROBLEM = ("sbml_files", "condition_files", "observable_files", "measurement_files", "visualization_files")


def _content(file: Path) -> dict[str, Any]:
    """The YAML file."""
    try:
        import yaml
    except ImportError:
        raise InputError(f"{file}: PEtab needs PyYAML; install it with: pip install 'casid[petab]'") from None
    try:
        content = yaml.safe_load(read_text_of(file))
    except (ValueError, yaml.YAMLError) as error:
        raise InputError(f"{file}: not a PEtab problem: {' '.join(str(error).split()):.200}") from None
    except RecursionError:
        raise InputError(f"{file}: not a PEtab problem: nested too deep") from None
    if not isinstance(content, dict):
        raise InputError(f"{file}: has {given(content):.60}; expected the YAML file of a PEtab problem")
    version = str(content.get("format_version", 1))
    if version.split(".")[0] != "1":
        raise InputError(f"{file}: PEtab version {version:.20}; only version 1 is read")
    return content


def _named(file: Path, content: Mapping[str, Any], key: str) -> list[Path]:
    """Files under a key, one or a list."""
    names = content.get(key)
    names = [names] if isinstance(names, str) else names
    if not isinstance(names, list) or not names or not all(isinstance(name, str) for name in names):
        raise InputError(f"{file}: '{key}' is {given(names):.60}; expected names of files")
    for name in names:
        if not (file.parent / a_path(name, f"{file}: '{key}'")).is_file():
            raise InputError(f"{file}: '{key}' names '{name}', which is no file beside it")
    return [file.parent / name for name in names]


def _rows(path: Path, columns: Sequence[str]) -> list[Row]:
    """A table, of which some columns have to be there; a byte order mark is none of its text."""
    try:
        text = io.StringIO(read_bytes(path).decode("utf-8-sig"), newline="")
        names, *cells = [*csv.reader(text, delimiter="\t")] or [[]]
    except (ValueError, csv.Error) as error:
        raise InputError(f"{path}: not a table of tab-separated text: {error}") from None
    names = [name.strip() for name in names]
    for number, row in enumerate(cells, 1):
        if any(row) and ("".join(row[len(names) :]).strip() or not set(names[len(row) :]) <= set(_OPTIONAL)):
            raise InputError(f"{path}: row {number} has {len(row)} cells; expected {len(names)}, one a column")
    absent = {name.lower(): name for name in _OPTIONAL if name not in names}
    for name in names:
        if name and names.count(name) > 1:
            raise InputError(f"{path}: column '{name}' stands twice; remove one")
        slip = get_close_matches(name.lower(), absent, 1, _CLOSE) if name not in _OPTIONAL else ()
        if slip:
            raise InputError(f"{path}: column '{name}' is none of PEtab; did you mean '{absent[slip[0]]}'?")
    rows: list[Row] = [dict(zip_longest(names, map(str.strip, row), fillvalue="")) for row in cells if any(row)]
    for name in columns:
        if name not in names:
            raise InputError(f"{path}: no column '{name}'; it has {', '.join(names) or 'nothing':.200}")
    return rows


def _check_unique(paths: Sequence[Path], column: str, rows: Sequence[Row]) -> None:
    names = [row[column] for row in rows]
    for name in names:
        if not name or names.count(name) > 1:
            fault = f"'{name}' stands twice" if name else "a row has no name"
            raise InputError(f"{paths[0]}: column '{column}': {fault}; expected a name of its own in every row")
