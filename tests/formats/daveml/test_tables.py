"""A DAVE-ML table of three dimensions: a wrong stretch is named with its range, and mended where it stands."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from small_flight import NOISE, multistep

import casid as cs
from casid.diagnosis.diagnose import diagnose
from casid.errors import InputError
from casid.model.aircraft import Aircraft, EffectValue
from casid.model.dynamics import aircraft_model
from casid.model.effects import catalogue
from casid.model.simulate import simulate
from casid.model.trim import trim
from casid.records.record import Record
from problems.do328 import STABLE, do328

MACH, ELEVATOR, ALPHA = (0.3, 0.36, 0.44, 0.55), (-20.0, 0.0, 20.0), tuple(range(-6, 20, 2))
FAST, SLOW = 144.0, 115.0  # m/s: at 3000 m Mach 0.44 and 0.35
HIDDEN = 0.02  # that Cm is wrong by at alpha of 2 and 4 degrees, near Mach 0.44
TERM = "alpha[0,0.0349066,0.0698132,0.10472]*mach[0.36,0.44,0.44,0.55]"
FILE = """<?xml version="1.0"?>
<DAVEfunc xmlns="http://daveml.org/2010/DAVEML">
  <variableDef name="mach" varID="M" units="nd"><isInput/></variableDef>
  <variableDef name="angleOfAttack" varID="al" units="deg"><isInput/></variableDef>
  <variableDef name="elevatorDeflection" varID="de" units="deg"><isInput/></variableDef>
  <variableDef name="referenceWingChord" varID="c" units="m" initialValue="2.04"/>
  <variableDef name="referenceWingSpan" varID="b" units="m" initialValue="20.8"/>
  <variableDef name="referenceWingArea" varID="S" units="m2" initialValue="40.0"/>
  <variableDef name="aeroBodyForceCoefficient_X" varID="cx" units="nd" initialValue="0"/>
  <variableDef name="aeroBodyForceCoefficient_Y" varID="cy" units="nd" initialValue="0"/>
  <variableDef name="aeroBodyForceCoefficient_Z" varID="cz" units="nd" initialValue="0"/>
  <variableDef name="aeroBodyMomentCoefficient_Roll" varID="cl" units="nd" initialValue="0"/>
  <variableDef name="aeroBodyMomentCoefficient_Pitch" varID="cm" units="nd"><isOutput/></variableDef>
  <variableDef name="aeroBodyMomentCoefficient_Yaw" varID="cn" units="nd" initialValue="0"/>
  <breakpointDef bpID="MACH"><bpVals>{mach}</bpVals></breakpointDef>
  <breakpointDef bpID="DE"><bpVals>{elevator}</bpVals></breakpointDef>
  <breakpointDef bpID="AL"><bpVals>{alpha}</bpVals></breakpointDef>
  {apart}
  <!-- <function><dependentVarRef varID="cm"/><dataTable> 9, 9 </dataTable> as it was in 1998 </function> -->
  <function name="static"><independentVarRef varID="M"/><independentVarRef varID="de"/><independentVarRef varID="al"/>
    <dependentVarRef varID="cm"/><functionDefn>{inside}</functionDefn></function>
</DAVEfunc>
"""
TABLE = """<griddedTableDef name="tunnel" gtID="T">
      <breakpointRefs><bpRef bpID="MACH"/><bpRef bpID="DE"/><bpRef bpID="AL"/></breakpointRefs>
      <dataTable> <!-- 1, 2 of 1998 -->
{values}</dataTable></griddedTableDef>"""
MASS = """<DAVEfunc xmlns="http://daveml.org/2010/DAVEML">
  <variableDef name="totalMass" varID="m" units="kg" initialValue="10500"/>
  <variableDef name="bodyMomentOfInertia_Roll" varID="ixx" units="kgm2" initialValue="103e3"/>
  <variableDef name="bodyMomentOfInertia_Pitch" varID="iyy" units="kgm2" initialValue="158e3"/>
  <variableDef name="bodyMomentOfInertia_Yaw" varID="izz" units="kgm2" initialValue="240e3"/>
  <variableDef name="bodyProductOfInertia_ZX" varID="izx" units="kgm2" initialValue="12.5e3"/>
  <variableDef name="bodyPositionOfCmWrtMrc_X" varID="dx" units="m" initialValue="{forward}"/>
  <variableDef name="bodyPositionOfCmWrtMrc_Y" varID="dy" units="m" initialValue="0"/>
  <variableDef name="bodyPositionOfCmWrtMrc_Z" varID="dz" units="m" initialValue="0"/>
</DAVEfunc>
"""


def values_of(wrong: float) -> np.ndarray:
    """(mach, elevator, alpha) the Do 328's Cm without its damping, to four digits."""
    de, al = np.radians(ELEVATOR)[:, None], np.radians(ALPHA)
    plane = STABLE["Cm_0"] + STABLE["Cm_delta_e"] * de + STABLE["Cm_alpha"] * al
    table = np.repeat(np.round(plane, 4)[None], len(MACH), axis=0)
    table[MACH.index(0.44), :, [ALPHA.index(2), ALPHA.index(4)]] += wrong
    return table


def written(path: Path, wrong: float = 0.0, apart: bool = False, forward: float = 0.0) -> tuple[Path, Path]:
    rows = values_of(wrong).reshape(-1, len(ALPHA))
    table = TABLE.format(values="".join("  " + ", ".join(f"{x:.4f}" for x in row) + ",\n" for row in rows))
    points = {"mach": MACH, "elevator": ELEVATOR, "alpha": ALPHA}
    lists = {name: ", ".join(map(str, axis)) for name, axis in points.items()}
    inside = '<griddedTableRef gtID="T"/>' if apart else table
    path.write_text(FILE.format(**lists, apart=table if apart else "", inside=inside))
    inertia = path.with_name("inertia.dml")
    inertia.write_text(MASS.format(forward=forward))
    return path, inertia


def plane(aerodynamics: Path, inertia: Path) -> Aircraft:
    """The Do 328 in body axes: its file has the static pitching moment, the rest are derivatives."""
    body = {"CZ_0": -0.248, "CZ_alpha": -6.03, "CZ_q": -4.39, "CZ_delta_e": -0.349, "CX_0": -0.027, "CX_alpha": 0.3}
    rest = {name: value for name, value in STABLE.items() if name[:2] in ("CY", "Cl", "Cn") or name == "Cm_q"}
    return replace(
        Aircraft.from_daveml(aerodynamics, inertia).with_derivatives(body | rest),
        moment_length_lateral=10.4,
        rate_length_pitch=2.04,
        gravity=do328().gravity,
        trim={"V": FAST, "thrust": 10e3},
    )


def flights(truth: Aircraft, noise: float = 1.0) -> list[Record]:
    """Four records of 12 s at two speeds, elevator, aileron and rudder moved one after the other."""
    rng = np.random.default_rng(7)
    model, t, found = aircraft_model(truth), np.arange(0.0, 12.0, 0.04), []
    for k, V in enumerate((FAST, SLOW, FAST, SLOW)):
        level, sign = trim(truth, V=V, altitude=3000.0), (-1.0) ** (k // 2)
        channels = {channel: np.full(len(t), value) for channel, value in level.inputs.items()}
        moves = {"delta_e": sign * 0.07 * multistep(t, 0.4, 0.5 + 0.05 * k)}
        moves |= {"delta_a": 0.05 * multistep(t, 5.5, 0.3), "delta_r": sign * 0.05 * multistep(t, 8.0, 0.3)}
        channels |= {name: channels[name] + move for name, move in moves.items()}
        flown = simulate(model, Record(name=f"m{k}", t=t, channels=channels), level.state).as_record(f"m{k}")
        noisy = {o: flown[o] + noise * rng.normal(0.0, sigma, len(t)) for o, sigma in NOISE.items()}
        found.append(flown.without(*(c for c in flown.channels if c not in (*channels, *NOISE))).with_channels(**noisy))
    return found


@pytest.mark.slow
def test_a_wrong_stretch_is_named_with_its_range_and_mended_where_it_stands(tmp_path: Path) -> None:
    own, inertia = written(tmp_path / "own.dml")
    true, _ = written(tmp_path / "true.dml", wrong=HIDDEN)
    aircraft, truth = plane(own, inertia), plane(true, inertia)
    records = flights(truth)
    found = diagnose(aircraft, records[:2], records[2:])
    assert found.verdict == "explained"
    assert [(c.kind, c.target, c.term) for c in found.causes] == [("table_increment", "Cm", TERM)]
    cause = found.causes[0]
    assert "Cm at alpha 2 to 4 deg, mach near 0.44 needs 0.02 more" in cause.sentence
    assert cause.value == pytest.approx(HIDDEN, abs=4.0 * cause.std)
    assert cause.std < 0.05 * HIDDEN

    found.extended_aircraft.write(tmp_path / "extended.dml")
    mended = plane(tmp_path / "extended.dml", inertia)
    clean, before, after = (flights(one, noise=0.0)[0] for one in (truth, aircraft, mended))
    for channel in ("q", "alpha", "theta"):
        wrong, left = (np.std(record[channel] - clean[channel]) for record in (before, after))
        assert left < 0.1 * wrong, channel


def rates(aircraft: Aircraft) -> np.ndarray:
    """(states, 8) rates of the state, at some angles and speeds."""
    model = cs.aircraft_model(aircraft)
    f = ca.Function("f", [model.x, model.u, model.p, model.w], [model.f])
    surfaces = {"delta_e": -0.03, "delta_a": 0.0, "delta_r": 0.0, "thrust": 0.0, "rho": 0.9}
    at = [surfaces[name] for name in model.inputs]
    states = [(V, 0.0, w, 0.0, 0.05, 0.0, 0.1, 0.0) for V in (112.0, 135.0, 160.0) for w in (-4.0, 3.0, 8.0, 13.0)]
    still = np.zeros(len(model.disturbances))
    return np.array([f(state, at, model.nominal_vector(), still).full()[:, 0] for state in states])


@pytest.mark.parametrize("apart", [False, True])
def test_the_file_with_the_table_mended_flies_like_the_effect(tmp_path: Path, apart: bool) -> None:
    """Whether the table stands in its function or is referred to; only its six numbers have changed: at two angles of
    attack, three elevators, one Mach number."""
    own, inertia = written(tmp_path / "own.dml", apart=apart)
    aircraft = plane(own, inertia)
    assert ("Cm", TERM) in {(e.target, e.term) for e in catalogue(aircraft, ("q",)) if e.kind == "table_increment"}
    extended = aircraft.with_effects([EffectValue(kind="table_increment", target="Cm", term=TERM, value=HIDDEN)])
    extended.write(tmp_path / "extended.dml")
    text = (tmp_path / "extended.dml").read_text()
    true, _ = written(tmp_path / "true.dml", wrong=HIDDEN, apart=apart)
    numbers = [
        [float(n) for n in re.findall(r"(?<![\w.])-?\d+\.\d{1,4}(?=\s*,)", one)] for one in (text, true.read_text())
    ]
    assert numbers[0] == pytest.approx(numbers[1], abs=1e-12) and len(numbers[0]) > 150
    plain, again = rates(aircraft), rates(plane(tmp_path / "extended.dml", inertia))
    assert np.abs(again - plain).max() > 1e-3, "the stretch must be met"
    rounding = 1e-5 * np.abs(again - plain).max()  # corners are known to six digits
    np.testing.assert_allclose(rates(extended) - plain, again - plain, rtol=0.0, atol=rounding)


def test_what_no_table_can_have_stands_in_a_comment(tmp_path: Path) -> None:
    own, inertia = written(tmp_path / "own.dml")
    effects = [
        EffectValue(kind="actuator_lag", target="delta_e", value=0.2),
        EffectValue(kind="table_increment", target="Cm", term=TERM, value=HIDDEN, records=("m1",)),
    ]
    plane(own, inertia).with_effects(effects).write(tmp_path / "extended.dml")
    text = (tmp_path / "extended.dml").read_text()
    assert text.count("has no place in a table of a DAVE-ML file") == 2 and "CZ: -6.03 times alpha" in text
    with pytest.raises(InputError, match=r"written as \.xml, of a DAVE-ML file as \.dml"):
        plane(own, inertia).write(tmp_path / "extended.xml")


def test_a_force_in_a_table_has_its_moment(tmp_path: Path) -> None:
    """Of a table of CZ, about a centre of mass 0.5 m before the reference: dCm = dx dCZ / c."""
    own, inertia = written(tmp_path / "own.dml", forward=0.5)
    swapped = own.read_text().replace('varID="cz" units="nd" initialValue="0"', 'varID="cz" units="nd"')
    swapped = swapped.replace(
        'varID="cm" units="nd"><isOutput/></variableDef>', 'varID="cm" units="nd" initialValue="0"/>'
    )
    own.write_text(swapped.replace('dependentVarRef varID="cm"', 'dependentVarRef varID="cz"'))
    aerodynamics = Aircraft.from_daveml(own, inertia).aerodynamics
    (one,) = aerodynamics.tables  # pyright: ignore[reportOptionalMemberAccess, reportAttributeAccessIssue]
    assert (one.coefficient, one.axes, one.times) == ("CZ", ("mach", "delta_e", "alpha"), "0")
    slopes = aerodynamics.of_table(one, {})  # pyright: ignore[reportOptionalMemberAccess, reportAttributeAccessIssue]
    found = {name: float(ca.evalf(ca.SX(value))) for name, value in slopes.items()}
    assert found == pytest.approx({"CX": 0.0, "CY": 0.0, "CZ": 1.0, "Cl": 0.0, "Cm": 0.5 / 2.04, "Cn": 0.0})
