"""Blind tests: sets that repeat, say nothing of what they hide, and are found.

Truths: the definition of each effect in the vocabulary, and the sealed answer of each set.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from casid.diagnosis.criteria import Criteria
from casid.errors import InputError
from casid.model.terms import parse_term
from casid.model.vocabulary import KINDS
from casid.records.record import Record
from problems.blind import do328 as blind_do328
from problems.blind import jsbsim as blind_jsbsim
from problems.blind.case import FAMILIES, NOT_DRAWN, OUTSIDE, RECORDS, Answer, Hidden
from problems.blind.draw import draw_effect, draw_two
from problems.blind.flown import FLOWN_HZ, effect_value, turbulence
from problems.blind.manoeuvres import CONTROLS, draw_segments, histories
from problems.blind.outside import SIGNALS, Outside, along
from problems.blind.scene import Scene, even_products
from problems.blind.score import ELSEWHERE, NOTHING, UNEXPLAINED, score
from problems.blind.sets import CASES, REPORTING_FROM, Set, fly_set, generate, hide, set_name
from problems.blind.solve import solve
from problems.blind.table import by_kind, columns, confusion, power, rows, summary
from problems.jsbsim.airframe import RATE_HZ
from problems.jsbsim.apriori import coefficients, geometry, regress, regressors_of
from problems.jsbsim.fleet import DEVELOPMENT, REPORTING, fleet_airframe

T = np.arange(0.0, 20.0, 1.0 / FLOWN_HZ)


@lru_cache
def deviations() -> dict[str, np.ndarray]:
    segments = draw_segments(np.random.default_rng(5), 20.0, blind_do328.plane().units_s, throttle=True)
    return histories(segments, T, blind_do328.plane().sizes)


@lru_cache
def healthy() -> Record:
    return blind_do328.plane().fly("m1", T, deviations())


def flown(*hidden: Hidden, outside: Outside | None = None) -> Record:
    return blind_do328.plane().fly("m1", T, deviations(), hidden, outside, seed=3)


@lru_cache
def scene() -> Scene:
    """Four times the same flight of the Do 328."""
    aircraft = blind_do328.plane().aircraft
    records = tuple(healthy().between(0.0, 20.0, name) for name in RECORDS)
    structure = {
        c: ("0", "alpha", "q", "delta_e") if c in ("CL", "CD", "Cm") else ("0", "beta", "p", "r", "delta_a", "delta_r")
        for c in aircraft.coefficients
    }
    return Scene(
        aircraft=aircraft,
        records=records,
        structure=structure,
        sizes=blind_do328.plane().sizes,
        configuration={"CL": 0.1, "CD": 0.02},
        free_steps=True,
    )


def same(one: Set, other: Set) -> bool:
    return all(
        np.array_equal(a[c], b[c]) for a, b in zip(one.records, other.records, strict=True) for c in a.channels
    ) and (one.aircraft, one.answer) == (other.aircraft, other.answer)


@pytest.mark.slow
def test_a_seed_gives_the_same_set_again_and_another_seed_another() -> None:
    first = fly_set("do328", "actuator_lag", 7)
    assert same(first, fly_set("do328", "actuator_lag", 7))
    assert not same(first, fly_set("do328", "actuator_lag", 8))


@pytest.mark.parametrize("of", ["do328", "jsbsim", "do328_instruments"])
def test_the_solver_is_told_nothing(of: str, tmp_path: Path) -> None:
    """The folder has four records and an aircraft file; no name, no content, no neighbour speaks of the effect."""
    if of == "jsbsim":
        pytest.importorskip("jsbsim", reason='no jsbsim: pip install "casid[jsbsim]"')
    name = hide(of, "backlash", 7, tmp_path / "sets", tmp_path / "answers")
    folder = tmp_path / "sets" / name
    assert sorted(file.name for file in folder.iterdir()) == ["aircraft.toml", *(f"{r}.csv" for r in RECORDS)]
    words = {"effects", "seed", "fault", "hidden", "truth", "clean", *KINDS, *OUTSIDE}
    words -= {"mass", "inertia", "thrust_line"}  # keys of every aircraft file
    for file in folder.iterdir():
        text = file.read_text(encoding="utf-8").lower()
        assert not any(word in text for word in words), file
    answer = Answer.read(tmp_path / "answers" / f"{name}.json")
    assert (answer.case, answer.seed, answer.hidden[0].kind) == ("backlash", 7, "backlash")


def test_names_do_not_follow_the_case() -> None:
    names = {set_name(of, case, seed) for of in ("do328", "jsbsim", "f16") for case in CASES for seed in range(5)}
    assert len(names) == 3 * len(CASES) * 5
    assert all(len(name) == 10 and set(name) <= set("0123456789abcdef") for name in names)


def test_development_and_reporting_share_nothing() -> None:
    assert not set(DEVELOPMENT) & set(REPORTING)
    assert REPORTING_FROM == 1000


@pytest.mark.parametrize("kind", sorted(set(KINDS) - set(NOT_DRAWN)))
def test_every_kind_is_drawn_in_the_words_of_the_vocabulary(kind: str) -> None:
    """Twenty draws of each kind make valid effects: target, term and unit are checked by the aircraft file itself."""
    for seed in range(20):
        one = draw_effect(np.random.default_rng(seed), kind, scene())
        assert one.kind == kind
        assert one.value != 0.0
        assert set(one.records) <= set(RECORDS)
        if kind != "turbulence":
            assert effect_value(one).unit == one.unit
        if one.onset_s is not None:
            assert set(one.onset_s) == set(one.records)
            edge = Criteria().numerics.events.step
            assert all(edge < onset < 20.0 - edge for onset in one.onset_s.values())


def test_two_effects_are_of_different_families() -> None:
    for seed in range(20):
        first, second = draw_two(np.random.default_rng(seed), scene())
        kinds = {next(f for f, members in FAMILIES.items() if one.kind in members) for one in (first, second)}
        assert len(kinds) == 2 or "thrust" in (first.target, second.target)


def test_a_term_is_drawn_beside_what_the_model_has() -> None:
    """Of a model with free terms of Cn only, one in p: p times the elevator counts without its part at trim."""
    hidden = draw_effect(np.random.default_rng(4), "aero_term", replace(scene(), structure={"Cn": ("0", "p", "r")}))
    assert hidden.target == "Cn"
    with_p, without = (replace(scene(), structure={"Cn": terms}) for terms in (("0", "p", "r"), ("0", "beta")))
    column = with_p.column("p*delta_e")
    moved = column - with_p.column("p") * np.mean(with_p.column("delta_e"))
    asked = with_p.size_of_share("Cn", column, 0.01)
    assert asked == pytest.approx(with_p.size_of_share("Cn", moved, 0.01), rel=1e-9)
    assert asked[0] > without.size_of_share("Cn", column, 0.01)[0]


def test_families_are_the_vocabulary() -> None:
    assert sorted(kind for kinds in FAMILIES.values() for kind in kinds) == sorted(KINDS)


def test_products_obey_the_symmetry_of_an_aircraft() -> None:
    assert {"alpha*beta", "alpha*p"} <= set(even_products("Cl"))
    assert not {"alpha^2", "beta^2"} & set(even_products("Cl"))
    assert {"alpha^2", "beta^2"} <= set(even_products("Cm"))
    assert "beta^3" in even_products("Cn", (3,))


def test_a_drawn_term_adds_the_share_that_was_asked_for() -> None:
    """What the file's own terms leave of it has the r.m.s. asked for, by an independent least squares."""
    term = scene().column("alpha^2")
    value, share = scene().size_of_share("Cm", term, 0.02)
    A = np.stack([scene().column(t) for t in scene().structure["Cm"]], axis=1)
    left = value * (term - A @ (np.linalg.pinv(A) @ term))
    assert np.std(left) / np.std(scene().coefficients["Cm"]) == pytest.approx(share, rel=1e-6)
    assert share <= 0.02 * (1 + 1e-9)


@pytest.mark.parametrize(
    ("hidden", "channel"),
    [
        (Hidden(kind="sensor_bias", target="q", value=0.006), "q"),
        (Hidden(kind="sensor_delay", target="alpha", value=0.1), "alpha"),
        (Hidden(kind="sensor_lag", target="phi", value=0.2), "phi"),
    ],
)
def test_an_instrument_fault_shows_in_its_channel_alone(hidden: Hidden, channel: str) -> None:
    right, faulty = healthy(), flown(hidden)
    for name in ("V", "alpha", "beta", "q", "r", "phi", "az"):
        assert np.allclose(faulty[name], right[name], atol=1e-12) == (name != channel)
    if hidden.kind == "sensor_bias":
        np.testing.assert_allclose(faulty["q"] - right["q"], 0.006, atol=1e-12)
    if hidden.kind == "sensor_delay":
        shift = round(0.1 * FLOWN_HZ)
        np.testing.assert_allclose(faulty["alpha"][shift:], right["alpha"][:-shift], atol=1e-9)


def test_flight_begins_in_steady_flight_with_the_effect_in_force() -> None:
    """A shifted centre of gravity is trimmed: nothing moves before the first input."""
    record = flown(Hidden(kind="cg_offset", target="y", value=0.1))
    quiet = record.t < 0.4
    for name, channel in record.channels.items():
        if name.startswith(("delta", "thrust")):
            assert np.ptp(channel[quiet]) < 1e-12
    for name in ("V", "alpha", "p", "q", "r", "phi"):
        assert np.ptp(record[name][quiet]) < 1e-6, name
    assert abs(record["delta_a"][0]) > 1e-3


def test_wind_meets_the_aircraft_and_not_what_its_instruments_say() -> None:
    """A shear that stays over the ground turns with the true heading: what is flown with a biased yaw rate, from
    which a heading would be wrong by 8 deg, differs in that reading alone."""
    t = np.arange(0.0, 12.0, 1.0 / FLOWN_HZ)
    turn = {"delta_a": 0.03 * ((t > 2.0) & (t < 4.0)), "delta_r": 0.0 * t, "delta_e": 0.0 * t, "throttle": 0.0 * t}
    shear = Hidden(kind="wind_shear", target="x", value=-0.4, onset_s={"m1": 3.0}, records=("m1",))
    bias = Hidden(kind="sensor_bias", target="r", value=0.012)
    one, both = (blind_do328.plane().fly("m1", t, turn, hidden) for hidden in ((shear,), (shear, bias)))
    assert np.abs(one["phi"]).max() > 0.1, "it does not turn"
    for channel in ("V", "beta", "p", "phi", "ay"):
        assert both[channel] == pytest.approx(one[channel], abs=1e-9)
    assert both["r"] - one["r"] == pytest.approx(np.full(len(t), 0.012))


def test_turbulence_has_its_rms() -> None:
    """r.m.s. per axis over an hour, within 15 % (some 300 correlation lengths)."""
    gusts = turbulence(np.random.default_rng(1), np.arange(0.0, 3600.0, 0.05), 1.5, 144.0, 20.98)
    for axis in "xyz":
        assert np.std(gusts[f"wind_{axis}"]) == pytest.approx(1.5, rel=0.15)


def test_manoeuvres_move_every_surface_and_return() -> None:
    for seed in range(30):
        t = np.arange(0.0, 24.0, 0.01)
        segments = draw_segments(np.random.default_rng(seed), 24.0, blind_do328.plane().units_s, throttle=seed % 2 == 0)
        moved = histories(segments, t, blind_do328.plane().sizes)
        for name in CONTROLS[:3]:
            assert np.ptp(moved[name]) > blind_do328.plane().sizes[name]
            assert abs(moved[name]).max() < 2.5 * blind_do328.plane().sizes[name]
            assert moved[name][-1] == pytest.approx(0.0, abs=1e-3)
        assert bool(np.ptp(moved["throttle"])) == (seed % 2 == 0)


@pytest.mark.parametrize("kind", [kind for kind in OUTSIDE if kind not in ("sensor_drift", *NOT_DRAWN)])
def test_an_effect_outside_follows_the_motion_that_it_makes(kind: str) -> None:
    """The moment that was flown is that of the derivatives and of the law along the motion flown (Euler's equation)."""
    outside = Outside(kind=kind, target="Cl", size=0.002, V=144.0, frequency_hz=0.8, threshold=0.05)
    record = flown(outside=outside)
    law = along(outside, record.t, {name: record[name] for name in SIGNALS})
    aircraft = blind_do328.plane().aircraft
    found, of_law = coefficients(aircraft, record), {"Cl": 0.0, "Cm": 0.0, "Cn": 0.0} | law
    variables = regressors_of(aircraft, record) | {"0": 1.0}
    for name in ("Cl", "Cm", "Cn"):
        derivatives = {n.split("_", 1)[1]: v for n, v in aircraft.derivatives.items() if n.startswith(f"{name}_")}
        modelled = sum(value * variables[term] for term, value in derivatives.items())
        left = found[name] - modelled - of_law[name]
        assert np.std(left) < 0.02 * max(np.std(found[name] - modelled), 1e-5), name


def test_an_effect_outside_is_made_in_jsbsim_too() -> None:
    """What a hum adds to the yawing moment of JSBSim's flight is the law, once the aircraft's own derivatives have
    answered for the motion that it causes."""
    pytest.importorskip("jsbsim", reason='no jsbsim: pip install "casid[jsbsim]"')
    frame = fleet_airframe("T37")
    t = np.arange(round(12.0 * RATE_HZ) + 1) / RATE_HZ
    moved = histories(draw_segments(np.random.default_rng(2), 12.0, frame.units_s, throttle=False), t, frame.sizes)
    outside = Outside(kind="propeller_hum", target="Cn", size=0.002, V=frame.speed_mps, frequency_hz=2.0)
    log, calm = blind_jsbsim.fly(frame, "m1", moved)
    _, humming = blind_jsbsim.fly(frame, "m1", moved, outside=outside)
    bare = geometry("T37", log, calm)
    terms = regress(bare, [calm]).values["Cn"]
    modelled = sum(value * parse_term(term).evaluate(regressors_of(bare, humming)) for term, value in terms.items())
    added = coefficients(bare, humming)["Cn"] - modelled
    law = along(outside, t, {name: humming[name] for name in SIGNALS})["Cn"]
    assert np.std(law) > 5e-4
    # JSBSim applies in the next step what it is told after this one
    np.testing.assert_allclose(added[1:], law[:-1], atol=0.03 * law.max())


def test_stall_breaks_above_and_ends_below_another_angle() -> None:
    outside = Outside(kind="stall_break", target="Cl", size=1.0, V=100.0, threshold=0.10)
    t = np.arange(0.0, 8.0, 0.01)
    alpha = np.interp(t, [0, 2, 4, 6, 8], [0.05, 0.12, 0.12, 0.095, 0.05])
    signals = dict.fromkeys(SIGNALS, np.zeros_like(t)) | {"alpha": alpha, "V": np.full_like(t, 100.0)}
    lost = along(outside, t, signals)["Cl"]
    assert lost[t < 1.0].max() == 0.0
    assert lost[(t > 3.0) & (t < 6.0)].min() > 0.9  # still separated below the angle at which it broke
    assert lost[-1] < 0.05


@pytest.mark.slow
@pytest.mark.parametrize(
    ("of", "case", "seed"), [("do328", "input_delay", 2), ("jsbsim", "clean-2", 2), ("jsbsim", "cg_offset", 1)]
)
def test_what_is_hidden_is_found(of: str, case: str, seed: int, tmp_path: Path) -> None:
    """The records and the aircraft file alone lead to the answer: named first and nothing else, or nothing at all when
    nothing is there."""
    if of == "jsbsim":
        pytest.importorskip("jsbsim", reason='no jsbsim: pip install "casid[jsbsim]"')
    places = {"sets": str(tmp_path / "sets"), "answers": str(tmp_path / "answers")}
    name = generate({"of": of, "case": case, "seed": seed, "size": 1.0, **places})
    scored = score(Answer.read(tmp_path / "answers" / f"{name}.json"), solve({"folder": str(tmp_path / "sets" / name)}))
    assert scored.wrong == 0
    assert scored.first == (case != "clean-2")
    if case == "clean-2":
        assert scored.verdict in ("adequate", "values wrong")  # the file's values are a guess
    elif scored.sized:
        assert abs(scored.sized[0]) < 0.1


# -- scores ------------------------------------------------------------------------------------------------------------


def answer(*hidden: Hidden, case: str = "gust") -> Answer:
    return Answer(
        of="do328",
        case=case,
        seed=1,
        size=1.0,
        aircraft="Do 328",
        hidden=hidden,
        mismatch={},
        conditions={"durations_s": (26.0,) * 4},
    )


def found(*causes: Mapping[str, Any], verdict: str = "explained") -> dict[str, Any]:
    return {
        "verdict": verdict,
        "causes": list(causes),
        "contradicted": [],
        "seconds": {"naming": 2.0, "kinematics": 1.0},
    }


def cause(kind: str, target: str, value: float = 1.0, std: float = 0.1, **more: Any) -> dict[str, Any]:
    return {
        "kind": kind,
        "target": target,
        "term": None,
        "value": value,
        "std": std,
        "statistic": 100.0,
        "records": list(RECORDS),
        "onset_s": None,
        "indistinguishable_from": [],
        **more,
    }


GUST = Hidden(kind="gust", target="z", value=4.0, records=("m1", "m2"), onset_s={"m1": 5.0, "m2": 7.0})


def test_scores_by_definition() -> None:
    exact = score(answer(GUST), found(cause("gust", "z", 4.1, onset_s={"m1": [4.9, 5.1], "m2": [7.1, 7.2]})))
    assert (exact.first, exact.same_family, exact.wrong, exact.onsets, exact.sized) == (
        True,
        True,
        0,
        (1, 2),
        (pytest.approx(0.025), True),
    )
    other_axis = score(answer(GUST), found(cause("gust", "y")))
    assert (other_axis.first, other_axis.same_family, other_axis.wrong, other_axis.named) == (False, True, 1, ELSEWHERE)
    alike = [{"kind": "gust", "target": "z", "term": None}]
    in_set = score(answer(GUST), found(cause("sensor_bias", "q", indistinguishable_from=alike)))
    assert (in_set.first, in_set.wrong, in_set.named, in_set.sized) == (True, 0, "gust", None)
    moved = Hidden(kind="cg_offset", target="x", value=-0.1, records=("m1", "m3", "m4"))
    back = score(answer(moved, case="cg_offset"), found(cause("cg_offset", "x", 0.105, std=0.01, records=["m2"])))
    assert back.sized == (pytest.approx(-0.05), True)
    silent = score(answer(GUST), found(verdict="adequate"))
    assert (silent.first, silent.named) == (False, NOTHING)
    assert score(answer(case="clean-1"), found(cause("gust", "z"))).wrong == 1
    both = score(
        answer(GUST, Hidden(kind="mass", value=9.0), case="two-1"), found(cause("mass", ""), cause("gust", "z"))
    )
    assert (both.hits, both.wrong, both.first) == (2, 0, True)
    gyroscope = answer(Hidden(kind="rotor_gyroscope", target="Cm", value=1.0), case="rotor_gyroscope")
    assert score(gyroscope, found(verdict="unexplained")).named == UNEXPLAINED
    said = score(gyroscope, found(cause("aero_term", "Cm", term="r")))
    assert (said.described, said.wrong) == (True, 1)
    assert score(answer(GUST), {"failed": "no"}).verdict == "failed"


def test_a_cause_that_values_reproduce_counts_as_it_is_told() -> None:
    """A damper that is told as one gain of three derivatives: right where one is hidden, wrong where none is, and first
    where it explains most. A factor that no cause makes is no cause."""
    damper = Hidden(kind="feedback", target="delta_r", term="r", value=0.3)
    told = {"cause": "feedback(delta_r:r)", "factor": 0.29, "std": 0.01, "statistic": 300.0}
    for statistic, first in ((200.0, True), (400.0, False)):
        scored = score(answer(damper), found({**cause("gust", "z"), "statistic": statistic}) | {"factors": [told]})
        assert (scored.hits, scored.first, scored.wrong) == (1, first, 1)
    area = {**told, "cause": ""}
    assert score(answer(case="clean-1"), found(verdict="adequate") | {"factors": [told]}).wrong == 1
    assert score(answer(case="clean-1"), found(verdict="adequate") | {"factors": [area]}).wrong == 0


def test_intervals_of_contradicted_values_are_counted() -> None:
    """One deviation away is inside the 95 % interval, three are not. Another lift changes the aircraft: no value of
    the healthy one is the truth then."""
    told = [
        {"parameter": "Cm_q", "flight": -33.0, "std": 3.0, "impossible": False},
        {"parameter": "Cm_alpha", "flight": -1.2, "std": 0.1, "impossible": False},
        {"parameter": "inertia", "flight": None, "std": None, "impossible": True},
    ]
    truth = replace(answer(GUST), values={"Cm_q": -42.0, "Cm_alpha": -1.3})
    counted = score(truth, found() | {"contradicted": told})
    assert counted.values == (1, 2)
    assert dict(summary([counted, counted]))["contradicted values: truth inside the 95 % interval"] == "2 of 4 (50 %)"
    term = replace(truth, hidden=(Hidden(kind="aero_term", target="Cm", term="alpha^3", value=-60.0),))
    assert score(term, found() | {"contradicted": told}).values == (0, 0)


def test_change_of_configuration_need_not_have_its_smallest_step() -> None:
    hidden = Hidden(kind="configuration_change", target="CL+CD+Cm", value=0.1)
    assert score(answer(hidden), found(cause("configuration_change", "CL+CD"))).first
    assert not score(answer(hidden), found(cause("configuration_change", "CL+CY"))).first


def test_tables_count_every_set_once() -> None:
    scores = [
        score(answer(GUST), found(cause("gust", "z", 4.1))),
        score(answer(GUST), found(verdict="adequate")),
        score(answer(case="clean-1"), found(verdict="adequate")),
    ]
    counts = confusion(scores)
    assert counts == {("gust", "gust"): 1, ("gust", NOTHING): 1, ("clean", NOTHING): 1}
    assert {row for row, _ in counts} <= set(rows())
    assert {column for _, column in counts} <= set(columns())
    measured = dict(summary(scores))
    assert measured["one effect: first or in its set"] == "1 of 2 (50 %)"
    assert measured["clean: sets with a name"] == "0 of 1 (0 %)"
    assert [(row["case"], row["sets"]) for row in by_kind(scores)] == [("clean", 1), ("gust", 2)]
    assert power(scores)[0]["sets"] == 2


# -- the script --------------------------------------------------------------------------------------------------------


def test_script_keeps_seeds_apart(load_script) -> None:
    script = load_script("blind")
    assert list(script.parse_seeds("3..5")) == [3, 4, 5]
    assert list(script.parse_seeds("1000")) == [1000]
    for wrong in ("5..3", "999..1000", "a", "1-3"):
        with pytest.raises(InputError, match="--seeds"):
            script.parse_seeds(wrong)
    todo = script.tasks(["do328"], range(1, 3), ["clean-*", "gust"], [1.0, 0.5], Path("x"))
    assert sum(task["case"] == "gust" for task in todo.values()) == 4
    assert sum(task["case"] == "clean-3" for task in todo.values()) == 2
    with pytest.raises(InputError, match="--kinds"):
        script.tasks(["do328"], range(1, 2), ["nothing"], [1.0], Path("x"))
