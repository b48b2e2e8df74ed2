"""A wrong stretch of a table: the truth is another table, flown; the diagnosis has the wrong one."""

from __future__ import annotations

import tomllib
from dataclasses import replace
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from small_flight import NOISE, multistep

import casid as cs
from casid.diagnosis.diagnose import diagnose
from casid.errors import InputError
from casid.model.aircraft import Aircraft
from casid.model.causes.tables import table_increment
from casid.model.dynamics import aircraft_model
from casid.model.effects import catalogue
from casid.model.simulate import simulate
from casid.model.terms import Stretch, parse_term
from casid.model.trim import trim
from casid.model.vocabulary import effect_sentence, effect_title
from casid.records.record import Record
from problems.do328 import V_TRIM, do328

ALPHA = [round(x, 4) for x in np.radians(np.arange(-6.0, 19.0, 2.0))]
MACH = [0.2, 0.3, 0.45]
HIDDEN = 0.02  # that Cm is wrong by at alpha of 2 and 4 degrees


def with_table(axes: tuple[str, ...], **options: object) -> Aircraft:
    """The Do 328 with its static pitching moment as a table."""
    linear = do328()
    steady = [linear.derivatives["Cm_0"] + linear.derivatives["Cm_alpha"] * alpha for alpha in ALPHA]
    values = steady if axes == ("alpha",) else [[value] * len(MACH) for value in steady]
    points = ALPHA if axes == ("alpha",) else [ALPHA, MACH]
    one = cs.table("Cm", axes, points, values, name="Cm static", **options)
    return replace(linear.with_derivatives({"Cm_0": 0.0, "Cm_alpha": 0.0}), tables=(one,))


def with_error(aircraft: Aircraft, by: float) -> Aircraft:
    """Another table, changed by hand at its two breakpoints."""
    one = aircraft.tables[0]
    values = np.reshape(one.grid.values, one.grid.shape).copy()
    values[4:6] += by
    return replace(aircraft, tables=(cs.table("Cm", one.axes, one.grid.breakpoints, values, name=one.name),))


def flights(truth: Aircraft) -> list[Record]:
    """Three noisy records of 12 s, elevator, aileron and rudder moved one after the other."""
    rng = np.random.default_rng(7)
    model, level = aircraft_model(truth), trim(truth, V=V_TRIM, altitude=3000.0)
    t, found = np.arange(0.0, 12.0, 0.04), []
    for k, sign in enumerate((1.0, -1.0, 1.0)):
        channels = {channel: np.full(len(t), value) for channel, value in level.inputs.items()}
        moves = {"delta_e": sign * (0.07, 0.07, 0.09)[k] * multistep(t, 0.4, 0.5 + 0.1 * k)}
        moves |= {"delta_a": 0.05 * multistep(t, 5.5, 0.3), "delta_r": sign * 0.05 * multistep(t, 8.0, 0.3)}
        channels |= {name: channels[name] + move for name, move in moves.items()}
        flown = simulate(model, Record(name=f"m{k}", t=t, channels=channels), level.state).as_record(f"m{k}")
        noisy = {o: flown[o] + rng.normal(0.0, sigma, len(t)) for o, sigma in NOISE.items()}
        found.append(flown.without(*(c for c in flown.channels if c not in (*channels, *NOISE))).with_channels(**noisy))
    return found


def test_a_wrong_stretch_is_named_with_its_range_and_mended_in_the_users_file(tmp_path: Path) -> None:
    aircraft = with_table(("alpha",))
    records = flights(with_error(aircraft, HIDDEN))
    found = diagnose(aircraft, records[:2], records[2:])
    assert [(c.kind, c.target, c.term) for c in found.causes] == [
        ("table_increment", "Cm", "alpha[0,0.0349,0.0698,0.1047]")
    ]
    assert found.verdict == "explained"
    assert "Cm at alpha 2 to 4 deg needs 0.02 more" in found.causes[0].sentence
    assert found.causes[0].value == pytest.approx(HIDDEN, abs=4.0 * found.causes[0].std)
    assert found.causes[0].std < 0.05 * HIDDEN

    own = tmp_path / "plane.toml"
    aircraft.write(own)
    own.write_text(own.read_text().replace("[aerodynamics.tables", "# from the tunnel\n[aerodynamics.tables", 1))
    found.extended_aircraft.write(tmp_path / "extended.toml", like=own)
    text = (tmp_path / "extended.toml").read_text()
    assert "# from the tunnel" in text
    mended = np.array(tomllib.loads(text)["aerodynamics"]["tables"]["Cm static"]["values"])
    change = mended - np.array(aircraft.tables[0].grid.values)
    np.testing.assert_allclose(change[4:6], found.causes[0].value, rtol=1e-12)
    assert not np.delete(change, [4, 5]).any()
    assert "table_increment" not in text  # the table says it, and nothing says it twice


def test_a_change_of_the_table_flies_like_the_effect() -> None:
    """Exactly between the breakpoints, and beyond the last where its value is held."""
    aircraft, motion = with_table(("alpha", "mach")), np.linspace(-0.2, 0.4, 61)
    increments = [e for e in catalogue(aircraft, ("q",)) if e.kind == "table_increment"]
    x = {name: ca.SX.sym(name) for name in ("alpha", "mach")}
    for effect in increments[::9]:
        assert effect.forms.into_tables is not None and effect.term is not None
        taken = effect.forms.into_tables(aircraft.tables, 0.03)
        assert taken is not None
        change = taken[0].at(x, {}) - aircraft.tables[0].at(x, {}) - 0.03 * parse_term(effect.term).evaluate(x)
        off = ca.Function("off", [*x.values()], [change])
        for mach in (0.1, 0.27, 0.5):
            assert np.abs(off(motion[None], mach).full()).max() < 1e-5, effect.name


def test_candidates_are_what_a_change_of_the_table_can_be() -> None:
    def terms(aircraft: Aircraft) -> set[str]:
        return {e.term or "" for e in catalogue(aircraft, ("q",)) if e.kind == "table_increment"}

    assert not terms(do328())
    assert not terms(with_table(("alpha",), method="spline"))
    assert not terms(with_table(("alpha",), free=True))
    held, sloping = terms(with_table(("alpha",))), terms(with_table(("alpha",), outside="linear"))
    assert "alpha[-inf,-inf,-0.1047,-0.0698]" in held
    assert sloping == {term for term in held if "inf" not in term}
    assert "alpha[0,0.0349,0.0698,0.1047]*mach[0.2,0.3,0.3,0.45]" in terms(with_table(("alpha", "mach")))


def test_words() -> None:
    term = "alpha[0.10,0.1396,0.2443,0.3]*mach[0.5,0.7,0.7,0.9]"
    told = "Cm at alpha 8 to 14 deg, mach near 0.7 needs 0.02 more."
    assert effect_sentence("table_increment", "Cm", term, 0.02).endswith(told)
    assert effect_title("table_increment", "Cm", "alpha[-inf,-inf,0.1,0.2]") == "Cm table: alpha below 5.73 deg"


def test_a_stretch_is_one_inside_and_falls_to_zero() -> None:
    one = Stretch(variable="alpha", corners=(0.1, 0.2, 0.4, 0.5))
    assert parse_term(one.name).stretches == (one,)
    x = np.array([0.0, 0.1, 0.15, 0.2, 0.3, 0.4, 0.475, 0.5, 0.9])
    np.testing.assert_allclose(one.evaluate(x), [0.0, 0.0, 0.5, 1.0, 1.0, 1.0, 0.25, 0.0, 0.0], atol=1e-12)
    assert table_increment("Cm", one.name).unit == "1"


@pytest.mark.parametrize(
    "text",
    ["alpha[1,2]", "alpha[a,b,c,d]", "alpha[0,2,1,3]", "alpha[-inf,0,1,2]", "alpha[-inf,-inf,inf,inf]", "al[0,1,2,3]"],
)
def test_what_is_no_stretch_is_refused(text: str) -> None:
    with pytest.raises(InputError) as caught:
        parse_term(text)
    assert "\n" not in str(caught.value)
