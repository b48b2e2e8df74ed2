"""The first screen of a diagnosis. Truth: the command line itself; page, terminal and JSON have one content."""

from __future__ import annotations

import shlex
from collections.abc import Iterator
from dataclasses import replace

import pytest
from cyclopts import App

from casid.cli.app import COMMANDS
from casid.diagnosis.cause import Cause
from casid.diagnosis.document import Called, Document
from casid.diagnosis.first_screen import FirstScreen
from casid.diagnosis.result import Diagnosis
from casid.model.causes.air import gust
from casid.model.causes.controls import actuator_lag, input_delay
from casid.model.causes.instruments import sensor_bias
from casid.model.effect import Effect
from casid.model.vocabulary import title_of

CALLED = Called(records="'a b/m*.csv' --map alpha=ALCG:deg", aircraft="plane.toml", out="out of it/found")


def ambiguous(found: Diagnosis, first: Effect, second: Effect) -> Diagnosis:
    """With a cause that cannot be told from another one."""
    alike = {"kind": second.kind, "target": second.target, "term": None, "title": title_of(second), "value": 0.05}
    cause: Cause = replace(found.causes[0], effect=first, value=0.05, indistinguishable_from=(alike,))
    return replace(found, causes=(cause,), contradicted=())


def variants(found: Diagnosis, wrong: Document) -> Iterator[Document]:
    """Return documents of every verdict, and of causes at every place of the signal path."""
    called = replace(found, called=CALLED)
    pairs = ((input_delay("delta_r"), actuator_lag("delta_r")), (gust("z"), sensor_bias("q")))
    yield called.document(figures=False)
    yield from (ambiguous(called, *pair).document(figures=False) for pair in pairs)
    for verdict in ("adequate", "values wrong", "explained", "partly explained", "unexplained", "data at fault"):
        some = found.causes if "explained" in verdict[-9:] else ()
        yield replace(called, verdict=verdict, causes=some, data=wrong.data).document(figures=False)


@pytest.fixture(scope="module")
def documents(diagnosis: Diagnosis, wrong_in_all: Document) -> list[Document]:
    return list(variants(diagnosis, wrong_in_all))


def test_every_command_is_one_of_the_command_line_with_valid_options(documents: list[Document]) -> None:
    app = App(name="casid")
    for name, where in COMMANDS.items():
        app.command(where, name=name)
    asked = [one.command for document in documents for one in document.next if one.command]
    assert {"match", "simulate", "design", "check"} <= {shlex.split(one)[1] for one in asked}
    for one in asked:
        program, *words = shlex.split(one)
        assert program == "casid"
        app.parse_args(words, exit_on_error=False, print_error=False)
        assert CALLED.out in one


def test_there_is_something_to_do_after_every_verdict(documents: list[Document]) -> None:
    assert all(document.next for document in documents)
    assert {"text", "command"} == {key for document in documents for one in document.to_dict()["next"] for key in one}


def test_data_at_fault_are_corrected_before_anything_else(documents: list[Document]) -> None:
    (document,) = [one for one in documents if one.verdict == "data at fault"]
    assert [shlex.split(one.command)[1] for one in document.next] == ["check"]


def test_a_gust_is_separated_by_no_manoeuvre(documents: list[Document]) -> None:
    of_gust = [one for one in documents if any(cause.kind == "gust" for cause in one.causes)]
    assert of_gust and not any("--separate" in step.command for one in of_gust for step in one.next)


def test_the_shares_are_whole_and_add_up(documents: list[Document]) -> None:
    for document in documents:
        shares = FirstScreen.of(document).shares
        assert not shares or sum(one.percent for one in shares) == 100
        assert all(one.percent > 0 for one in shares)


def test_the_terminal_has_what_the_screen_has(documents: list[Document], diagnosis: Diagnosis) -> None:
    screen = FirstScreen.of(diagnosis.document(figures=False))
    lines = str(diagnosis).splitlines()
    assert lines[0].endswith(screen.verdict)
    assert all(any(one.sentence in line for line in lines) for one in screen.found)
    assert all(any(line.strip() == one.command for line in lines) for one in diagnosis.document(False).next)
    budget = diagnosis.budget
    rows = [line.split() for line in lines[lines.index("") :]]
    assert all(any(row[:1] == [name] for row in rows) for name in budget.channels)
