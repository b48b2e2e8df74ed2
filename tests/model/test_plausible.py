"""What no aircraft has. Truth: the published Do 328, the demo and real aircraft are well; one number each is put into
another unit."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from casid.cli.new_multirotor import multirotor_text
from casid.model.aircraft import Aircraft
from casid.model.airframe import INERTIAS, Inertia
from casid.model.effect_value import EffectValue
from casid.model.plausible import believable, doubts, impossibilities
from problems.do328 import do328
from problems.faults.flights import REAL, real_flight

TRIM = {"V": 144.0, "rho": 0.8934, "alpha": 0.006, "thrust": 10000.0}


def plane() -> Aircraft:
    return replace(do328(), trim=TRIM)


def trimmed(**changes: float) -> Callable[[Aircraft], Aircraft]:
    return lambda a: replace(a, trim={**a.trim, **changes})


def per_degree(a: Aircraft) -> Aircraft:
    return a.with_derivatives({"CL_alpha": a.derivatives["CL_alpha"] / 57.3})


def in_pounds_and_feet(a: Aircraft) -> Aircraft:
    return replace(a, inertia=Inertia(**{name: getattr(a.inertia, name) / 0.0421401 for name in INERTIAS}))


@pytest.mark.parametrize(
    ("change", "parameter"),
    [
        (lambda a: replace(a, mass=a.mass / 1000.0), "mass"),
        (lambda a: replace(a, area=a.area / 0.09290304), "area"),
        (lambda a: replace(a, gravity=1.62), "gravity"),
        (in_pounds_and_feet, "inertia"),
        (per_degree, "CL_alpha"),
        (trimmed(rho=0.8934 / 515.4), "trim rho"),
        (trimmed(thrust=10.0), "trim thrust"),
        (trimmed(V=144.0 / 0.3048), "trim lift"),
    ],
)
def test_a_number_in_another_unit_is_in_doubt(change: Callable[[Aircraft], Aircraft], parameter: str) -> None:
    found = {one.parameter: one for one in doubts(change(plane()))}
    assert parameter in found and parameter.removeprefix("trim ") in found[parameter].sentence


def test_aircraft_are_well(repo: Path) -> None:
    assert doubts(plane()) == ()
    assert doubts(Aircraft.read(repo / "casid" / "cli" / "demo" / "aircraft.toml")) == ()


@pytest.mark.parametrize("name", REAL)
def test_real_aircraft_are_well(name: str, flight_data: Path) -> None:
    assert doubts(real_flight(name, flight_data.parent).aircraft) == ()


def test_what_is_in_doubt_is_left_out() -> None:
    """A trim that cannot be judges nothing, nor does another planet's gravity."""
    wrong = replace(trimmed(rho=0.0017)(plane()), gravity=1.62)
    assert "rho" not in believable(wrong, doubts(wrong)).trim
    assert believable(wrong, doubts(wrong)).gravity == pytest.approx(9.80665)
    assert believable(plane(), ()) is not None and believable(plane(), ()).trim == TRIM


@pytest.mark.parametrize(
    ("kind", "value", "bad"),
    [
        ("actuator_lag", -1.0, True),
        ("actuator_lag", 30.0, True),
        ("actuator_lag", 0.5, False),
        ("input_delay", -0.1, False),
        ("backlash", -0.01, True),
    ],
)
def test_a_lag_or_a_width_below_zero_is_impossible_and_a_delay_is_not(kind: str, value: float, bad: bool) -> None:
    """What acts may be ahead of its record; nothing answers before its command."""
    effect = EffectValue(kind=kind, target="delta_e", value=value)
    found = impossibilities(replace(plane(), effects=(effect,)))
    assert [one.parameter for one in found] == ([f"{kind}(delta_e)"] if bad else [])
    assert all("impossible" in one.sentence for one in found)


@pytest.mark.parametrize(("count", "mass", "arm"), [(4, 0.03, 0.046), (4, 0.5, 0.17), (6, 2.0, 0.3), (8, 25.0, 0.9)])
def test_a_multirotor_is_measured_by_its_arms(tmp_path: Path, count: int, mass: float, arm: float) -> None:
    """From the Crazyflie to a lifter; the same inertia in g cm2 is told."""
    (tmp_path / "a.toml").write_text(multirotor_text("a", count, mass, arm), encoding="utf-8")
    own = Aircraft.read(tmp_path / "a.toml")
    assert not doubts(own)
    (found,) = doubts(replace(own, inertia=Inertia(**{name: 1e7 * getattr(own.inertia, name) for name in INERTIAS})))
    assert found.parameter == "inertia" and "rotors at a distance" in found.sentence
