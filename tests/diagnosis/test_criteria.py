"""The numbers by which a diagnosis decides: each says what it means, and each may be given another value."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from diagnosis_flights import flights

from casid.diagnosis.criteria import Criteria
from casid.diagnosis.diagnose import diagnose
from casid.diagnosis.flight.hypothesis import Attached
from casid.errors import InputError
from casid.model.causes.instruments import sensor_bias
from problems.do328 import do328


def test_every_number_says_what_it_means_and_what_it_rests_on() -> None:
    rows = Criteria().rows
    assert len({row.name for row in rows}) == len(rows) > 0
    for row in rows:
        assert row.meaning and row.evidence.split(":")[0] in ("derived", "measured", "chosen"), row.name


def test_a_file_changes_what_it_names_and_nothing_else(tmp_path: Path) -> None:
    path = tmp_path / "my.toml"
    path.write_text("[significance]\nsearch = 60\n[structure]\nscales = [1, 3, 9]\n[numerics.naming]\nranking = 2\n")
    read = Criteria.read(path)
    assert read.changes == {
        "structure.scales": (1.0, 3.0, 9.0),
        "significance.search": 60.0,
        "numerics.naming.ranking": 2,
    }
    assert replace(
        read, significance=Criteria().significance, structure=Criteria().structure, numerics=Criteria().numerics
    ) == (Criteria())


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("[significance]\nserach = 60", "did you mean 'significance.search'"),
        ("[signifcance]\nsearch = 60", "did you mean 'significance.search'"),
        ("significance = 60", "expected e.g. significance.chance"),
        ("[significance]\nsearch = '60'", "'significance.search' is '60'; expected a number above 0"),
        ("[significance]\nsearch = -1", "'significance.search' is -1; expected a number above 0"),
        ("[significance]\nsearch = nan", "expected a number above 0"),
        ("[numerics.naming]\nranking = 2.5", "expected a whole number above 0"),
        ("[structure]\nscales = [1, 2]", "3 numbers, got [1, 2]"),
        ("[naming", "not valid TOML"),
    ],
)
def test_a_file_that_is_wrong_is_refused_in_one_line(tmp_path: Path, text: str, says: str) -> None:
    path = tmp_path / "my.toml"
    path.write_text(text)
    with pytest.raises(InputError) as error:
        Criteria.read(path)
    assert says in str(error.value) and str(path) in str(error.value) and "\n" not in str(error.value)


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="nothing.toml"):
        Criteria.read(tmp_path / "nothing.toml")


@pytest.mark.slow
def test_who_asks_for_more_names_less() -> None:
    """A biased vane is named, and where more gain is asked than it has, nothing is; its value is as it was."""
    records = flights([Attached(effect=sensor_bias("beta"), values={"value": 0.02})], count=2)
    found = diagnose(do328(), records)
    (named,) = found.causes
    assert (named.kind, named.target) == ("sensor_bias", "beta")
    strict = Criteria().with_values({"significance": {"search": 2.0 * named.statistic}})
    refused = diagnose(do328(), records, criteria=strict)
    assert not refused.causes and refused.verdict != "explained"
    assert refused.criteria == strict and refused.rounds[0].leader.effect.kind == "sensor_bias"
