"""Truth: a substance that is fed and decays, on paper: at rest before the beginning, from there, and at rest again."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from petab_cases import write

import casid as cs
from casid.errors import EstimationError, InputError

TIME = '<csymbol encoding="text" definitionURL="http://www.sbml.org/sbml/symbols/time">t</csymbol>'
SBML = """<?xml version="1.0" encoding="UTF-8"?>
<sbml xmlns="http://www.sbml.org/sbml/level3/version1/core" level="3" version="1"><model id="fed">
 <listOfParameters><parameter id="k" value="0.5" constant="true"/><parameter id="feed" value="1" constant="true"/>
  <parameter id="A" value="7" constant="false"/><parameter id="B" value="0" constant="false"/></listOfParameters>
 <listOfRules>
  <rateRule variable="A"><math xmlns="http://www.w3.org/1998/Math/MathML"><apply><minus/><ci>feed</ci>
   <apply><times/><ci>k</ci><ci>A</ci></apply></apply></math></rateRule>
  <rateRule variable="B"><math xmlns="http://www.w3.org/1998/Math/MathML"><apply><minus/><ci>A</ci><ci>B</ci></apply>
  </math></rateRule></listOfRules></model></sbml>
"""
T = np.array([0.0, 0.5, 1.0, 2.0, 4.0])
K, LOW, HIGH = 0.8, 1.2, 3.0


def folder(path: Path, mark: str = "", column: str = "B", entry: str = "nan", last: str = "inf") -> Path:
    """Fed little until it is at rest, then much; A is read, at last at infinity. B is set where `entry` is a number."""
    exact = HIGH / K + (LOW - HIGH) / K * np.exp(-K * T)
    noise = 0.01 * np.random.default_rng(4).standard_normal(len(T) + 1)
    read = [*zip(T.astype(str), exact, strict=True), (last, HIGH / K)]
    rows = [f"a\tlow\thigh\t{y + e!r}\t{t}" for (t, y), e in zip(read, noise, strict=True)]
    files = {
        "model.xml": SBML,
        "conditions.tsv": f"conditionId\tfeed\t{column}\nlow\tlittle\tnan\nhigh\t{HIGH}\t{entry}\n",
        "observables.tsv": "observableId\tobservableFormula\tnoiseFormula\na\tA\t0.01\n"
        "unread\tA*observableParameter1_unread\tnoiseParameter1_unread\n",
        "measurements.tsv": "observableId\tpreequilibrationConditionId\tsimulationConditionId\tmeasurement\ttime\n"
        + "\n".join(rows).replace("np.float64(", "").replace(")", "")
        + "\n",
        "parameters.tsv": "parameterId\tparameterScale\tlowerBound\tupperBound\tnominalValue\testimate\n"
        f"k\tlog10\t1e-3\t10\t0.5\t1\nlittle\tlin\t0\t10\t{LOW + 0.3}\t1\n",
        "problem.yaml": "format_version: 1\nparameter_file: parameters.tsv\nproblems:\n"
        "- condition_files: [conditions.tsv]\n"
        "  measurement_files: [measurements.tsv]\n  observable_files: [observables.tsv]\n  sbml_files: [model.xml]\n",
    }
    for name, text in files.items():
        (path / name).write_text((mark if name != "model.xml" else "") + text, encoding="utf-8")
    return path / "problem.yaml"


def test_a_condition_before_the_beginning_and_readings_at_rest(tmp_path: Path) -> None:
    problem = cs.read_petab(folder(tmp_path))
    fit = cs.solve(problem)
    (record,) = problem.records
    assert problem.model.outputs == ("a",)  # nobody read the other observable
    assert fit.converged
    assert fit["k"].value == pytest.approx(K, abs=4.0 * fit["k"].std) and fit["k"].std < 0.02
    assert fit["little"].value == pytest.approx(LOW, abs=4.0 * fit["little"].std) and fit["little"].std < 0.03
    values = fit.values
    later = record.t >= 0.0
    a = HIGH / values["k"] + (values["little"] - HIGH) / values["k"] * np.exp(-values["k"] * record.t[later])
    states = fit.states[record.name].trajectory[later]
    np.testing.assert_allclose(states[:, 0], a, atol=1e-3)
    assert states[0, 1] == pytest.approx(values["little"] / values["k"], abs=1e-3)  # B at rest follows A


def test_a_state_that_a_condition_sets_jumps_when_it_begins(tmp_path: Path) -> None:
    fit = cs.solve(cs.read_petab(folder(tmp_path, entry="9")))
    record = fit.problem.records[0]
    b = fit.states[record.name].trajectory[:, 1]
    assert fit.converged
    assert b[np.searchsorted(record.t, 0.0) + 1] > 5.0 > b[np.searchsorted(record.t, 0.0) - 1]


def test_a_byte_order_mark_is_no_text(tmp_path: Path) -> None:
    plain, marked = cs.read_petab(folder(tmp_path)), cs.read_petab(folder(tmp_path, mark="\ufeff"))
    assert marked.parameters == plain.parameters
    np.testing.assert_array_equal(marked.records[0]["a"], plain.records[0]["a"])


def test_what_never_comes_to_rest_is_said(tmp_path: Path) -> None:
    path = folder(tmp_path)
    model = tmp_path / "model.xml"
    model.write_text(model.read_text().replace("<apply><minus/><ci>A</ci><ci>B</ci></apply>", "<ci>A</ci>"))
    with pytest.raises(EstimationError, match="come to rest"):
        cs.read_petab(path)
    model.write_text(SBML.replace("<ci>A</ci><ci>B</ci>", f"<ci>A</ci>{TIME}"))
    with pytest.raises(EstimationError, match="steady state of a model with time"):
        cs.read_petab(path)


@pytest.mark.parametrize(
    ("file", "old", "new", "message"),
    [
        ("parameters.tsv", "0.5\t1\n", "0.5\tyes\n", "estimate of parameters 'yes'"),
        ("parameters.tsv", "k\tlog10", "k\tlog_10", "parameterScale of parameters 'log_10'"),
        ("parameters.tsv", "1e-3\t10\t0.5", "little\t10\t0.5", "'lowerBound' has 'little'"),
        ("parameters.tsv", "\t0.5\t1", "\t0_5\t1", "'nominalValue' has '0_5'"),
        ("observables.tsv", "\tlog10\t", "\tlog_10\t", "observableTransformation of observables 'log_10'"),
        ("observables.tsv", "\tnormal", "\tgauss", "noiseDistribution of observables 'gauss'"),
        ("parameters.tsv", "parameterScale", "parameterscal", "'parameterscal' is none of PEtab.*'parameterScale'"),
        ("parameters.tsv", "lowerBound", "upperBound", "column 'upperBound' stands twice"),
        ("parameters.tsv", "\t0.5\t1\n", "\t0.5\t1\t0\n", "row 1 has 7 cells; expected 6"),
        ("conditions.tsv", "\tA1\n", "\n", "row 3 has 3 cells; expected 4"),
        ("problem.yaml", "parameter_file", "parameter_flie: 1\nparameter_file", "unknown key 'parameter_flie'"),
        ("model.xml", 'compartment id="cell" size="2"', 'compartment id="cell" sise="2"', "attribute found on Compart"),
        ("model.xml", '<species id="A"', '<species id="A" conversionFactor="k"', "'A' has a conversionFactor"),
        ("model.xml", 'reversible="false" fast="false"', 'reversible="false" fast="true"', "'decay' is fast"),
    ],
)
def test_a_word_that_means_nothing_is_refused(tmp_path: Path, file: str, old: str, new: str, message: str) -> None:
    path = write(tmp_path)
    text = (tmp_path / file).read_text()
    assert old in text
    (tmp_path / file).write_text(text.replace(old, new, 1))
    with pytest.raises(InputError, match=message):
        cs.read_petab(path)


JUNK = (
    "",
    "nan",
    "inf",
    "-1",
    "abc",
    "1e999",
    "k",
    "A",
    "x y",
    "=1",
    "k*(",
    "0",
    "1;2",
    "y",
    "[1]",
    "\u00e9",
    "1,5",
    "t",
)
VALUES = ("", "3", "[]", "[1]", "{a: 1}", "null", "nothere.tsv", "[a, b]", "'..'")


def mutant(data: bytes, name: str, rng: np.random.Generator) -> bytes:
    """The file with one fault: cut off, bytes changed, a column, row or cell removed, doubled or exchanged."""
    kind = int(rng.integers(7))
    if kind == 0:
        return data[: rng.integers(len(data))]
    if kind == 1:
        changed = bytearray(data)
        for _ in range(3):
            changed[rng.integers(len(changed))] = rng.integers(256)
        return bytes(changed)
    if kind == 2:
        return b"" if rng.random() < 0.3 else b"\xff\xfe" + data
    text = data.decode()
    lines = text.rstrip("\n").split("\n")
    i = int(rng.integers(len(lines)))
    if kind == 3:
        lines[i] = lines[int(rng.integers(len(lines)))]
    elif kind == 4:
        del lines[i]
    elif name.endswith(".tsv"):
        rows = [line.split("\t") for line in lines]
        j = int(rng.integers(len(rows[0])))
        if kind == 5:
            rows = [row[:j] + row[j + 1 :] for row in rows]
        else:
            rows[i][j] = JUNK[int(rng.integers(len(JUNK)))]
        lines = ["\t".join(row) for row in rows]
    elif name.endswith(".yaml"):
        lines[i] = f"{lines[i].split(':')[0]}: {VALUES[int(rng.integers(len(VALUES)))]}"
    else:
        words = re.findall(r'"[^"]*"|<[^>]*>|[A-Za-z_0-9.]+', text)
        old, new = (words[int(k)] for k in rng.integers(len(words), size=2))
        places = [m.start() for m in re.finditer(re.escape(old), text)]
        at = places[int(rng.integers(len(places)))]
        return (text[:at] + new + text[at + len(old) :]).encode()
    return "\n".join(lines).encode()


@pytest.mark.filterwarnings("ignore::RuntimeWarning")  # numbers such as 1e999
@pytest.mark.parametrize("seed", range(40))
def test_a_broken_file_is_one_sentence(seed: int, tmp_path: Path) -> None:
    rng = np.random.default_rng(seed)
    path = folder(tmp_path) if seed % 2 else write(tmp_path)
    files = sorted(tmp_path.iterdir())
    for _ in range(5):
        file = files[int(rng.integers(len(files)))]
        whole = file.read_bytes()
        file.write_bytes(mutant(whole, file.name, rng))
        try:
            cs.read_petab(path)
        except (InputError, EstimationError) as error:
            assert "\n" not in str(error) and len(str(error)) < 1000
        file.write_bytes(whole)
