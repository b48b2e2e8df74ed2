"""`casid new-aircraft --rotors`: what is written hovers and answers as a multirotor does."""

from __future__ import annotations

import numpy as np
import pytest

import casid as cs
from casid.cli.new_aircraft import new_aircraft
from casid.errors import InputError


@pytest.mark.parametrize("count", [4, 6, 8])
def test_what_is_written_hovers_in_balance(tmp_path, count):
    path = tmp_path / "quad.toml"
    new_aircraft(path, rotors=count, mass=0.8, arm=0.15)
    aircraft = cs.Aircraft.read(path)
    assert aircraft.rotors is not None
    level = cs.trim(aircraft, V=0.0)
    thrusts = [one.static_thrust(level.rotors[one.name]) for one in aircraft.rotors.each]
    assert sum(thrusts) == pytest.approx(0.8 * 9.80665)
    np.testing.assert_allclose(sum(np.array(one.position) for one in aircraft.rotors.each), 0.0, atol=1e-3)
    assert sum(one.spin for one in aircraft.rotors.each) == 0.0
    np.testing.assert_allclose(list(level.rotors.values()), 0.5, rtol=1e-3)


@pytest.mark.parametrize("name", ['the "red" one', "back\\slash", "Möwe's"])
def test_any_name_is_read_back(tmp_path, name: str) -> None:
    new_aircraft(tmp_path / "quad.toml", name=name, rotors=4, mass=0.8, arm=0.15)
    assert cs.Aircraft.read(tmp_path / "quad.toml").name == name


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"mass": 0.8}, "--arm"),
        ({"mass": -1.0, "arm": 0.1}, "--mass"),
        ({"mass": 1.0, "arm": 0.1, "rotors": 3}, "4, 6 or 8"),
    ],
)
def test_what_is_missing_or_wrong_is_said(tmp_path, options, says):
    with pytest.raises(InputError, match=says):
        new_aircraft(tmp_path / "quad.toml", **{"rotors": 4, **options})
    assert not (tmp_path / "quad.toml").exists()
