"""What a diagnosis is told by in the end. Truth: the sentences that went in."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import pytest

import casid as cs
from casid.data_check.reading import Finding
from casid.diagnosis.cause import IN_A_SET
from casid.diagnosis.diagnose import named_in_errors
from casid.diagnosis.given.contradicted import Contradiction
from casid.diagnosis.given.factors import Factor
from casid.diagnosis.result import Diagnosis
from casid.diagnosis.verdict import concluded
from casid.errors import InputError
from casid.keeping import plain
from casid.model.plausible import Doubt
from problems.systems.count import SYSTEMS
from problems.systems.system import Fault

AT_FAULT = Finding(kind="data_sign", target="q", records=("m1",), handled="reported", sentence="q is reversed.")
IMPOSSIBLE = Doubt(parameter="mass", given=1.0, unit="kg", sentence="No aircraft has a mass of 1 kg.")
AGAINST = Contradiction(
    parameter="b", unit="1", given=1.0, flight=2.0, std=0.1, reversed=False, impossible=False, sentence="b is 2."
)
GROUP = Factor(row="all", factor=2.0, std=0.1, means=("area",), derivatives=("b", "c"), statistic=20.0)
DAMPER = replace(GROUP, cause="feedback(delta_r:r)", unit="s", as_if="as a gain of {number} would make them")


@pytest.mark.parametrize(("most", "more"), [(1, "And 3 more."), (3, "And 1 more."), (4, None)])
def test_errors_state_as_many_findings_as_the_criterion_says(most: int, more: str | None) -> None:
    findings = [
        Finding(kind="data_sign", target=name, records=("m1",), handled="reported", sentence=f"{name} is reversed.")
        for name in ("p", "q", "r", "ay")
    ]
    with pytest.raises(InputError) as error, named_in_errors(findings, (), most):
        raise InputError("nothing can be fitted")
    assert str(error.value).count("is reversed") == most
    assert str(error.value).endswith(more or "ay is reversed.")


@pytest.fixture(scope="module")
def explained() -> Diagnosis:
    """A diagnosis that names a cause and, besides, has something unexplained."""
    system = SYSTEMS["Lotka-Volterra"]
    records = system.fly(7, Fault(kind="missing_term", target="prey", term="prey^2", size=-0.06))
    found = cs.diagnose(system.model(), records, exact=system.exact, library=system.library)
    assert found.causes and found.believed
    return replace(found, entered={"prey": 0.9})


@pytest.mark.parametrize("reason", ["data", "file", "model"])
def test_no_probability_is_stated_of_what_is_withdrawn(explained: Diagnosis, reason: str) -> None:
    """Faults of the data, the file or the extended model: nothing is named, so nothing is believed either."""
    if reason == "model":
        together = replace(explained.budget.together, structure=math.inf)
        explained = replace(explained, budget=replace(explained.budget, together=together))
    data, doubts = [AT_FAULT] * (reason == "data"), [IMPOSSIBLE] * (reason == "file")
    found = concluded(explained, (), data=data, doubts=doubts)
    assert not found.causes
    assert not (found.explanations or found.believed or found.entered) and found.nothing is None
    document = json.loads(json.dumps(plain(found.to_dict())))
    assert [one["name"] for one in document["minor"]] == [one.name for one in explained.causes]
    assert {one[what] for one in document["minor"] for what in ("probability", "alone", "log_odds")} == {None}


def test_data_at_fault_contradict_no_number_nor_group(explained: Diagnosis) -> None:
    """The records that speak against the numbers are the ones at fault; without the fault they do contradict them."""
    assert concluded(explained, [AGAINST], [GROUP]).factors == (GROUP,)
    found = concluded(explained, [AGAINST], [GROUP], data=[AT_FAULT])
    assert (found.contradicted, found.factors) == ((), ())


def test_a_cause_that_values_reproduce_is_told_while_something_else_is_missing(explained: Diagnosis) -> None:
    """A number is nothing that the records say then. The gain of a damper that the model lacks is structure, and the
    decisions have it beside the values that it cannot be told from; but not where the data are at fault."""
    more = replace(explained, unexplained=explained.missing_before[:1])
    found = concluded(more, [AGAINST], [GROUP, replace(DAMPER, derivatives=("b", "d"))])
    assert [one.cause for one in found.factors] == ["feedback(delta_r:r)"] and not found.contradicted
    assert "as a gain of 2" in found.sentence and "No value is" in found.values_told
    (decision,) = found.why("feedback(delta_r:r)").decisions
    assert decision.outcome == IN_A_SET and decision.against == ("b", "d") and not decision.failed
    assert concluded(more, [AGAINST], [DAMPER], data=[AT_FAULT]).factors == ()


def test_a_fault_of_the_data_that_a_named_cause_explains_stands_in_its_set(explained: Diagnosis) -> None:
    """Nothing was corrected, for these data do not decide; the search names the other explanation. A fault with
    another rival stays one."""
    named = explained.causes[0]
    rival = {"kind": named.kind, "target": named.target}
    told = replace(AT_FAULT, title="q reversed", indistinguishable_from=(rival,))
    found = concluded(explained, (), data=[told])
    assert [one.name for one in found.causes] == [one.name for one in explained.causes]
    assert "q reversed" in [one["title"] for one in found.causes[0].indistinguishable_from]
    assert found.verdict != "data at fault" and json.dumps(plain(found.to_dict()))
    other = replace(told, indistinguishable_from=({**rival, "target": "elsewhere"},))
    assert concluded(explained, (), data=[other]).verdict == "data at fault"
