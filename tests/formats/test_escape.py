"""Names of strangers in the files that casid writes.

Truth: the file of a plain name, read by the rules of its language that are written down here: its code stays the same.
"""

from __future__ import annotations

import csv
import json
import re
import tomllib
import xml.etree.ElementTree as ET
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

import casid as cs
from casid.cli.options import DEMO

PLAIN = "plane"
PLANE = cs.Aircraft.read(DEMO / "aircraft.toml")
HOSTILE = [
    "x'); system('touch PWNED'); %",
    "%{",
    "'''",
    "=cmd|' /C calc'!A0",
    "+1+1",
    "@SUM(1)",
    '-- "--->" <!-- -',
    "a- --><sdf version='1.9'><plugin filename='PWN.so'/></sdf><!- -",
    "]]> &amp; <x/>",
    r"\input{/etc/passwd} $ ~ ^^M } \end{tabular}",
    "{{ 7 * 7 }} {% x %} ${HOME} `id`",
    '"\\", "s": 3, "x": "',
    "# [effects]",
    "Zürich 東京",
]


def matlab_code(text: str) -> str:
    """The statements of a script without what stands in quotes and comments."""
    code = []
    for line in text.splitlines():
        at, kept = 0, ""
        while at < len(line):
            if line[at] == "%":
                break
            if line[at] == "'":
                end = at + 1
                while line[end] != "'" or line[end + 1 : end + 2] == "'":
                    end += 1 if line[end] != "'" else 2
                at, kept = end + 1, kept + "''"
            else:
                at, kept = at + 1, kept + line[at]
        code.append(kept)
    return "\n".join(code)


def tex_code(text: str) -> str:
    return re.sub(r"(?<!\\)%.*", "%", text)


def xml_code(text: str) -> str:
    root = ET.fromstring(text)
    for node in (root, *root.iter("model")):
        node.attrib.pop("name", None)
    return ET.tostring(root, encoding="unicode")


def csv_code(text: str) -> str:
    rows = [row for row in csv.reader(text.splitlines()) if row[1] != "name" or row[0] != "aircraft"]
    cells = [cell for row in csv.reader(text.splitlines()) for cell in row]
    assert not [c for c in cells if c[:1] in "=+-@" and c and not re.fullmatch(r"[-+.e\d]+", c)]
    return repr(rows)


def json_code(text: str) -> str:
    return json.dumps(json.loads("\n".join(line for line in text.splitlines() if line[:1] != "#")))


TARGETS: list[tuple[str, str, Callable[[str], str]]] = [
    ("matlab", "m", matlab_code),
    ("latex", "tex", tex_code),
    ("gazebo", "sdf", xml_code),
    ("jsbsim", "xml", xml_code),
    ("csv", "csv", csv_code),
    ("ardupilot-json", "json", json_code),
]


@pytest.mark.parametrize(("to", "ending", "code"), TARGETS, ids=[to for to, _, _ in TARGETS])
def test_a_name_is_never_code(tmp_path: Path, to: str, ending: str, code: Callable[[str], str]) -> None:
    def written(name: str) -> str:
        cs.export(replace(PLANE, name=name), tmp_path / f"a.{ending}", to=to)
        return (tmp_path / f"a.{ending}").read_text(encoding="utf-8")

    plain = written(PLAIN)
    for name in HOSTILE:
        text = written(name)
        assert code(text) == code(plain), name
        assert len(text.splitlines()) == len(plain.splitlines()), name


@pytest.mark.parametrize("name", HOSTILE)
def test_a_name_comes_back_from_toml(tmp_path: Path, name: str) -> None:
    aircraft = replace(PLANE, name=name)
    aircraft.write(tmp_path / "plane.toml")
    assert cs.Aircraft.read(tmp_path / "plane.toml") == aircraft


LINES = ["a\nsystem('x')", "a\r", "a\x00b", "a\x1b[2J", "a\u2028b", "a\u202eb", "\ud800", "x" * 201, "a\x7f"]
PLACES: list[Callable[[str], object]] = [
    lambda bad: replace(PLANE, name=bad),
    lambda bad: cs.EffectValue(kind="mass", value=1.0, records=[bad]),
    lambda bad: cs.EffectValue(kind="mass", value=1.0, onset_s={bad: (0.0, 1.0)}),
    lambda bad: cs.EffectValue(kind="mass", value=1.0, parameters={bad: 1.0}),
    lambda bad: cs.table("Cm", "alpha", [0.0, 1.0], [0.0, 1.0], name=bad),
    lambda bad: cs.Record(name=bad, t=[0.0, 1.0], channels={}),
]


@pytest.mark.parametrize("bad", [*LINES, "x" * 2001], ids=repr)
@pytest.mark.parametrize("make", PLACES, ids=range(len(PLACES)))
def test_a_name_of_more_than_a_line_is_refused_on_one_line(make: Callable[[str], object], bad: str) -> None:
    with pytest.raises(cs.InputError) as caught:
        make(bad)
    assert str(caught.value).isprintable() and len(str(caught.value)) < 400


@pytest.mark.parametrize("key", ["x); system('touch PWNED'); (y", "a b", "1a", "", "ä", "x.y", "end\nx"])
def test_a_key_that_becomes_code_is_an_identifier(tmp_path: Path, key: str) -> None:
    text = (DEMO / "aircraft.toml").read_text(encoding="utf-8")
    entry = f'\n[[effects]]\nkind = "mass"\nvalue = 1.0\nparameters = {{ {json.dumps(key)} = 1.0 }}\n'
    tomllib.loads(text + entry)  # the file itself is sound
    (tmp_path / "a.toml").write_text(text + entry, encoding="utf-8")
    with pytest.raises(cs.InputError, match=r"a\.toml: .*parameters"):
        cs.Aircraft.read(tmp_path / "a.toml")
