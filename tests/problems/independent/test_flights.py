"""Sets of the independent simulator. Truths: the imports as they are written, the definition of each effect."""

from __future__ import annotations

import ast
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from casid.model.vocabulary import check_effect
from problems.blind.case import OUTSIDE as ALL_OUTSIDE
from problems.blind.sets import cases_of, set_name
from problems.blind.sets import fly_set as handed_over
from problems.independent import flights
from problems.independent.effects import CASES, ONE, OUTSIDE, RECORDS, Effect, draw
from problems.independent.flights import Plan, fly_set, linked, with_effect
from problems.independent.motion import STEP_S
from problems.independent.planes import JET, LIGHT

FOLDER = Path(flights.__file__).parent


def test_the_simulator_imports_numpy_and_itself_only() -> None:
    allowed = {"__future__", "numpy", "collections", "dataclasses", "types", "problems"}
    for path in FOLDER.glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            names += [str(node.module)] if isinstance(node, ast.ImportFrom) else []
            for name in names:
                assert name.split(".")[0] in allowed, (path.name, name)
                assert not name.startswith("problems") or name.startswith("problems.independent"), (path.name, name)


def test_flying_loads_nothing_of_casid() -> None:
    code = "import sys, problems.independent.flights; print([m for m in sys.modules if m[:5] in ('casid', 'probl')])"
    said = subprocess.run(
        [sys.executable, "-c", code], cwd=FOLDER.parents[1], capture_output=True, text=True, check=True
    )
    loaded = ast.literal_eval(said.stdout)
    assert not [name for name in loaded if name != "problems" and not name.startswith("problems.independent")]
    assert "problems.independent.flights" in loaded


def short(plan: Plan, seconds: float) -> Plan:
    """The beginning of a plan."""
    end = round(seconds / STEP_S) * 4 + 1
    deviation = {name: x[:end] for name, x in plan.deviation.items()}
    return replace(plan, t=plan.t[:end], deviation=deviation, durations=(seconds,) * len(RECORDS))


@pytest.mark.slow
def test_a_seed_gives_the_same_set_again_and_the_aircraft_take_turns() -> None:
    one, again, other = (fly_set("sensor_bias", seed) for seed in (7, 7, 8))
    assert all(np.array_equal(one.records[r][c], again.records[r][c]) for r in RECORDS for c in one.records[r])
    assert one.effect == again.effect
    assert {one.plane.name, other.plane.name} == {LIGHT.name, JET.name}


@pytest.mark.parametrize("case", list(ONE))
def test_every_effect_is_one_of_the_vocabulary(case: str) -> None:
    healthy = {name: np.random.default_rng(1).normal(0.0, 0.02, 500) for name in ("alpha", "beta", "p", "q", "r")}
    healthy |= {name: np.random.default_rng(2).normal(0.0, 0.02, 500) for name in ("delta_e", "delta_a", "delta_r")}
    healthy["mach"] = np.full(500, 0.5)
    for seed in range(10):
        effect = draw(case, JET, healthy, np.random.default_rng(seed))
        assert effect is not None
        check_effect(effect.kind, effect.target or None, effect.term)
        assert effect.records[-1] == RECORDS[-1] or effect.kind in ("cg_offset", "mass", "gust", "effectiveness_change")


def test_cases_and_names() -> None:
    assert cases_of("independent") == CASES
    assert len(CASES) == 4 + 13 + 2
    assert set(OUTSIDE) <= set(ALL_OUTSIDE)
    assert len({set_name("independent", case, 3001) for case in CASES}) == len(CASES)
    with pytest.raises(ValueError, match="unknown case"):
        fly_set("input_delay", 1)


def test_a_linkage_does_what_is_hidden_in_it_where_it_is() -> None:
    position = np.repeat(np.sin(np.linspace(0.0, 12.0, 2401))[:, None], 2, axis=1)
    has = np.array([1.0, 0.0])
    for kind, value in (("actuator_lag", 0.2), ("rate_limit", 0.3), ("backlash", 0.1)):
        acts = linked(Effect(kind=kind, target="delta_e", value=value), position, has)
        assert np.abs(acts[:, 0] - position[:, 0]).max() > 0.05
        assert np.allclose(acts[:, 1], position[:, 1], atol=1e-14)


def test_a_loading_changes_the_records_that_have_it() -> None:
    craft = flights.healthy_craft(LIGHT, len(RECORDS))
    heavy = with_effect(craft, Effect(kind="mass", value=90.0, records=("m3",)))
    assert np.array_equal(heavy.loading.mass - craft.loading.mass, [0, 0, 90, 0, 0])
    moved = with_effect(craft, Effect(kind="cg_offset", target="x", value=0.1, records=("m1", "m4")))
    assert np.array_equal(moved.loading.cg[0], [0.1, 0, 0, 0.1, 0])
    assert not moved.loading.cg[1:].any()


@pytest.mark.slow
def test_what_is_handed_over_is_what_was_flown() -> None:
    """The aircraft file has the mass of the tables' aircraft, and nothing of what is hidden."""
    flown, whole = fly_set("sensor_bias", 3), handed_over("independent", "sensor_bias", 3)
    assert (whole.aircraft.mass, whole.aircraft.area) == (flown.plane.mass, flown.plane.area)
    assert whole.aircraft.effects == ()
    assert whole.aircraft.derivatives["Cm_q"] == flown.derivatives["Cm"][("q",)]
    assert whole.aircraft.terms["CD"]["alpha^2"] == flown.derivatives["CD"][("alpha", "alpha")]
    assert [record.name for record in whole.records] == list(RECORDS)
    assert np.array_equal(whole.records[1]["q"], flown.records["m2"]["q"])
    assert flown.effect is not None
    assert whole.answer.hidden[0].value == flown.effect.value


def test_half_of_the_thrust_is_gone_from_its_onset_on() -> None:
    """The engine's own reading does not see it: the accelerometer does."""
    plan = short(flights.plan_of(JET, np.random.default_rng(4)), 3.0)
    quiet = replace(plan, deviation={name: 0.0 * x for name, x in plan.deviation.items()})
    onsets = dict.fromkeys(RECORDS, 2.0)
    effect = Effect(kind="effectiveness_change", target="thrust", value=-0.5, onset_s=onsets)
    level, log = flights.fly(flights.healthy_craft(JET, len(RECORDS)), quiet, effect)
    before, after = round(1.99 / STEP_S), round(2.01 / STEP_S)
    lost = log["force"][before, 0] - log["force"][after, 0]
    assert np.allclose(lost, 0.5 * log["thrust"][before] / JET.mass, rtol=1e-3)
    assert np.allclose(log["thrust"][after], log["thrust"][before], rtol=1e-3)
    assert np.allclose(log["x"][before, 3:6], level.state[3:6], atol=1e-6)
