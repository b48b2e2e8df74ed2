"""Stations: a key and what it says are one another's inverse, for every disturbance of an aircraft model."""

from __future__ import annotations

from dataclasses import replace

import pytest

from casid.errors import InputError
from casid.model.aircraft import Aircraft
from casid.model.airframe import AXES_COEFFICIENTS
from casid.model.path import OUTPUTS, disturbance_names
from casid.model.station import MOVING_AIR, Station, reading

DEMO = Aircraft.read("casid/cli/demo/aircraft.toml")


@pytest.mark.parametrize("axes", ["wind", "body"])
def test_a_key_is_taken_apart_and_put_together_again(axes: str) -> None:
    aircraft = replace(DEMO, force_axes=axes, derivatives={f"{AXES_COEFFICIENTS[axes][0]}_0": 0.0}, terms={}, std={})
    keys = [*disturbance_names(aircraft), *map(reading, OUTPUTS)]
    assert [Station.at(key).key for key in keys] == keys
    kinds = {kind: [s.name for s in map(Station.at, keys) if s.kind == kind] for kind in ("coefficient", "control")}
    assert kinds["coefficient"] == list(AXES_COEFFICIENTS[axes])
    assert kinds["control"] == ["delta_e", "delta_a", "delta_r", "thrust"]
    assert [s.name for s in map(Station.at, MOVING_AIR)] == ["x", "y", "z", "p", "q", "r"]


def test_words_of_a_sentence() -> None:
    words = [Station.at(key).words for key in ("dCm", "d_delta_e", "wind_z", "gust_p", "reading_theta")]
    assert words == ["Cm", "delta_e", "moving air along z", "rotation of the air about p", "the reading of theta"]


@pytest.mark.parametrize("key", ["V", "d", "wind_", ""])
def test_what_is_no_station_is_refused(key: str) -> None:
    with pytest.raises(InputError, match="unknown station"):
        Station.at(key)
