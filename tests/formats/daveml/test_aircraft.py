"""DAVE-ML files (ANSI/AIAA S-119): the F-16 of NASA's check cases by its own static shots, and a small file."""

from __future__ import annotations

import csv
import xml.etree.ElementTree as ET
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.optimize import least_squares

import casid as cs
from casid.errors import InputError
from casid.formats.daveml.functions import dave_file

SPACE = {"d": "http://daveml.org/2010/DAVEML"}
MATH = '<math xmlns="http://www.w3.org/1998/Math/MathML">{}</math>'
AERO = """<?xml version="1.0"?>
<DAVEfunc xmlns="http://daveml.org/2010/DAVEML">
  <variableDef name="trueAirspeed" varID="vt" units="m_s"><isInput/></variableDef>
  <variableDef name="angleOfAttack" varID="al" units="deg"><isInput/></variableDef>
  <variableDef name="bodyAngularRate_Pitch" varID="q" units="deg_s"><isInput/></variableDef>
  <variableDef name="elevatorDeflection" varID="de" units="rad"><isInput/></variableDef>
  {more}
  <variableDef name="referenceWingChord" varID="c" units="m" initialValue="2.0"/>
  <variableDef name="referenceWingSpan" varID="b" units="m" initialValue="10.0"/>
  <variableDef name="referenceWingArea" varID="S" units="m2" initialValue="20.0"/>
  <variableDef name="aeroBodyForceCoefficient_X" varID="cx" units="nd" initialValue="-0.02"/>
  <variableDef name="aeroBodyForceCoefficient_Y" varID="cy" units="nd" initialValue="0.0"/>
  <variableDef name="aeroBodyForceCoefficient_Z" varID="cz" units="nd"/>
  <variableDef name="aeroBodyMomentCoefficient_Roll" varID="cl" units="nd" initialValue="0.0"/>
  <variableDef name="aeroBodyMomentCoefficient_Pitch" varID="cm" units="nd">
    <calculation>{math}</calculation></variableDef>
  <variableDef name="aeroBodyMomentCoefficient_Yaw" varID="cn" units="nd" initialValue="0.0"/>
  <breakpointDef bpID="A"><bpVals>-10, 0, 20</bpVals></breakpointDef>
  <breakpointDef bpID="E"><bpVals>-0.4 0.4</bpVals></breakpointDef>
  <function name="CZ"><independentVarRef varID="de" extrapolate="{beyond}"/>
    <independentVarRef varID="al" extrapolate="{beyond}"/>
    <dependentVarRef varID="cz"/><functionDefn><griddedTableDef>
      <breakpointRefs><bpRef bpID="E"/><bpRef bpID="A"/></breakpointRefs>
      <dataTable>0.9, 0.1, -1.5, <!-- the last breakpoint changes most rapidly --> 0.7, -0.1, -1.9</dataTable>
    </griddedTableDef></functionDefn></function>
</DAVEfunc>
"""
INERTIA = """<DAVEfunc xmlns="http://daveml.org/2010/DAVEML">
  <variableDef name="totalMass" varID="m" units="kg" initialValue="1000"/>
  <variableDef name="bodyMomentOfInertia_Roll" varID="ixx" units="kgm2" initialValue="1000"/>
  <variableDef name="bodyMomentOfInertia_Pitch" varID="iyy" units="kgm2" initialValue="2000"/>
  <variableDef name="bodyMomentOfInertia_Yaw" varID="izz" units="kgm2" initialValue="2500"/>
  <variableDef name="bodyProductOfInertia_ZX" varID="izx" units="kgm2" initialValue="80"/>
  <variableDef name="bodyPositionOfCmWrtMrc_X" varID="dx" units="m" initialValue="0.2"/>
  <variableDef name="bodyPositionOfCmWrtMrc_Y" varID="dy" units="m" initialValue="0"/>
  <variableDef name="bodyPositionOfCmWrtMrc_Z" varID="dz" units="m" initialValue="0"/>
</DAVEfunc>
"""
SQUARE = "<apply><times/><cn>2</cn><ci>al</ci><ci>al</ci></apply>"


@pytest.fixture
def f16(flight_data: Path) -> Path:
    """Folder with the DAVE-ML files of the F-16."""
    for folder in (flight_data / "f16", flight_data.parent / "f16"):
        if (folder / "F16_aero.dml").is_file():
            return folder
    pytest.skip("no F-16: its DAVE-ML files are in nasa/simupy-flight, folder f16 beside the flight records")


def written(folder: Path, math: str = SQUARE, more: str = "", beyond: str = "neither") -> tuple[Path, Path]:
    aero, inertia = folder / "plane.dml", folder / "inertia.dml"
    aero.write_text(AERO.format(math=MATH.format(math), more=more, beyond=beyond), encoding="utf-8")
    inertia.write_text(INERTIA, encoding="utf-8")
    return aero, inertia


def shots_of(text: str) -> list[tuple[str, dict[str, float], dict[str, tuple[float, float]]]]:
    """(name, inputs, outputs with tolerance) of the static check cases of a file, by the standard's names."""
    found = []
    for shot in ET.fromstring(text).iterfind(".//d:staticShot", SPACE):
        sides = [
            {
                (signal.findtext("d:signalName", None, SPACE) or signal.findtext("d:varID", "", SPACE)).strip(): signal
                for signal in shot.iterfind(f"d:{side}/d:signal", SPACE)
            }
            for side in ("checkInputs", "checkOutputs")
        ]
        inputs = {name: number_in(signal, "signalValue") for name, signal in sides[0].items()}
        outputs = {n: (number_in(signal, "signalValue"), number_in(signal, "tol")) for n, signal in sides[1].items()}
        found.append((shot.get("name", ""), inputs, outputs))
    return found


def number_in(signal: ET.Element, tag: str) -> float:
    return float(signal.findtext(f"d:{tag}", "nan", SPACE))


@pytest.mark.parametrize("name", ["F16_aero.dml", "F16_prop.dml"])
def test_static_shots_within_their_tolerances(f16: Path, name: str) -> None:
    """Every output of every check case that NASA put into its file."""
    text = (f16 / name).read_text()
    file, shots = dave_file(text), shots_of(text)
    assert len(shots) == {"F16_aero.dml": 16, "F16_prop.dml": 9}[name]
    for shot, inputs, outputs in shots:
        look = file.values({file.varid(key): ca.SX(value) for key, value in inputs.items()})
        for key, (value, tolerance) in outputs.items():
            found = float(ca.evalf(ca.SX(look(file.varid(key)))))
            assert abs(found - value) <= tolerance, (shot, key)


STEP_S = 0.01  # of the integration of NASA's simulation: what it logs as forces is what acted over the step before
SPAN, CHORD = 30.0, 11.32  # ft


@pytest.fixture
def flown(f16: Path) -> Callable[[str], tuple[CubicSpline, np.ndarray, np.ndarray]]:
    """Of a trajectory of NASA: its motion in the units of the file as a function of time, times, six coefficients."""

    def read(name: str) -> tuple[CubicSpline, np.ndarray, np.ndarray]:
        with (f16 / f"Atmos_{name}_sim_02.csv").open() as text:
            rows = [{k: float(v) for k, v in row.items()} for row in csv.DictReader(text)]
        motion, coefficients = zip(*map(motion_and_coefficients, rows), strict=True)
        t = np.array([row["time"] for row in rows])
        return CubicSpline(t, np.array(motion)), t, np.array(coefficients)

    return read


def motion_and_coefficients(row: dict[str, float]) -> tuple[list[float], list[float]]:
    """NASA's simulation makes all three moments with the mean chord, where the file has the span for roll and yaw:
    see `test_forces_of_nasas_lateral_steps`."""
    psi, theta, phi = (np.radians(row[f"eulerAngle_deg_{name}"]) for name in ("Yaw", "Pitch", "Roll"))
    u, v, w = body_velocity(np.array([row[f"feVelocity_ft_s_{axis}"] for axis in "XYZ"]), psi, theta, phi)
    V = row["trueAirspeed_nmi_h"] * 1852.0 / 3600.0 / 0.3048
    assert np.linalg.norm([u, v, w]) == pytest.approx(V, rel=1e-6)
    rates = [np.radians(row[f"bodyAngularRateWrtEi_deg_s_{name}"]) for name in ("Roll", "Pitch", "Yaw")]
    qS = 0.5 * row["airDensity_slug_ft3"] * V**2 * 300.0
    force = [row[f"aero_bodyForce_lbf_{axis}"] / qS for axis in "XYZ"]
    moment = [row[f"aero_bodyMoment_ftlbf_{axis}"] / (qS * CHORD) for axis in "LMN"]
    return [V, np.degrees(np.arctan2(w, u)), np.degrees(np.arcsin(v / V)), *rates], [*force, *moment]


def unexplained_by_surfaces(f16: Path, motion: np.ndarray, logged: np.ndarray) -> float:
    """Largest part of the six coefficients that no elevator, aileron and rudder account for."""
    file = dave_file((f16 / "F16_aero.dml").read_text())
    s = {name: ca.SX.sym(name) for name in ("vt", "alpha", "beta", "p", "q", "r", "el", "ail", "rdr")}
    look = file.values(s)
    outputs = ca.vertcat(*(look(name) for name in ("cx", "cy", "cz", "cl", "cm", "cn")))
    aerodynamics = ca.Function("aerodynamics", list(s.values()), [outputs])
    fit = least_squares(
        lambda surfaces: aerodynamics(*motion, *surfaces).full()[:, 0] - logged, np.zeros(3), xtol=1e-12, ftol=1e-12
    )
    return float(np.abs(fit.fun).max())


@pytest.mark.parametrize("name", ["13p1", "13p3", "13p4"])
def test_forces_of_nasas_trimmed_flight(f16: Path, flown: Callable, name: str) -> None:
    """In the seconds before the step of check cases 13.1, 13.3 and 13.4, NASA's simulation logs forces and moments but
    no surfaces: three surfaces explain all six of them."""
    motion, t, logged = flown(name)
    for i in range(10, 46, 5):
        assert unexplained_by_surfaces(f16, motion(t[i]), logged[i]) < 1e-5, t[i]


def test_forces_of_nasas_altitude_step(f16: Path, flown: Callable) -> None:
    """In check case 13.1 the F-16 climbs by 100 ft from t = 5 s on: alpha comes from 6 to 1.5 degrees, the elevator
    from -4.4 to -2.6. At every point half a second after the step, three surfaces explain all six coefficients."""
    motion, t, logged = flown("13p1")
    assert np.ptp(motion(t)[:, 1]) > 4.0
    left = {t[i]: unexplained_by_surfaces(f16, motion(t[i] - STEP_S), logged[i]) for i in range(60, 200, 5)}
    assert max(left.values()) < 2e-5, left
    late = unexplained_by_surfaces(f16, motion(6.0), logged[60])
    assert late > 1e-3  # at the time of its row: the step matters, and the check can fail


@pytest.mark.parametrize(("name", "step_s"), [("13p3", 15.0), ("13p4", 20.0)])
def test_forces_of_nasas_lateral_steps(f16: Path, flown: Callable, name: str, step_s: float) -> None:
    """In check cases 13.3 and 13.4 the F-16 steps to another heading and aside; sideslip reaches 4 degrees.

    With roll and yaw moments over the chord three surfaces explain all six coefficients to 3e-6, 2 s after the step.
    Over the span, as the file and its static shots have it, more than 1e-3 is left, most of all in Cn: NASA's
    simulation makes the lateral moments 11.32/30 of what the file says, and flies with these.
    """
    motion, t, logged = flown(name)
    after = [i for i in range(int(10 * (step_s + 2.0)), int(10 * (step_s + 6.0)), 6)]
    left = [unexplained_by_surfaces(f16, motion(t[i] - STEP_S), logged[i]) for i in after]
    assert max(left) < 3e-6, left
    by_span = np.array([1.0, 1.0, 1.0, CHORD / SPAN, 1.0, CHORD / SPAN])
    other = unexplained_by_surfaces(f16, motion(t[after[0]] - STEP_S), by_span * logged[after[0]])
    assert other > 1e-3


def body_velocity(ned: np.ndarray, psi: float, theta: float, phi: float) -> np.ndarray:
    c, s = np.cos, np.sin
    about_z = np.array([[c(psi), s(psi), 0.0], [-s(psi), c(psi), 0.0], [0.0, 0.0, 1.0]])
    about_y = np.array([[c(theta), 0.0, -s(theta)], [0.0, 1.0, 0.0], [s(theta), 0.0, c(theta)]])
    about_x = np.array([[1.0, 0.0, 0.0], [0.0, c(phi), s(phi)], [0.0, -s(phi), c(phi)]])
    return about_x @ about_y @ about_z @ ned


def test_the_f16_is_an_aircraft(f16: Path) -> None:
    """Its mass is the 20500 lb that its file says; its c.g. at 25 % of the chord lies 1.132 ft before the reference."""
    aircraft = cs.Aircraft.from_daveml(f16 / "F16_aero.dml", f16 / "F16_inertia.dml", held={"CG_PCT_MAC": 25.0})
    assert aircraft.mass == pytest.approx(20500.0 * 0.45359237, rel=1e-5)
    own = aircraft.aerodynamics
    assert getattr(own, "cm", None) == pytest.approx((1.132 * 0.3048, 0.0, 0.0))
    level = cs.trim(aircraft, V=172.0, altitude=3000.0)
    assert 0.0 < level.alpha < 0.1 and 0.0 < level.thrust < 0.3 * aircraft.mass * 9.80665


def test_units_tables_and_the_centre_of_mass(tmp_path: Path) -> None:
    """Cm = 2 alpha^2 [deg] about the reference; the centre of mass lies 0.2 m before it, so that CZ turns, too."""
    aero, inertia = written(tmp_path)
    aircraft = cs.Aircraft.from_daveml(aero, inertia)
    assert (aircraft.mass, aircraft.inertia.Ixz, aircraft.area) == (1000.0, 80.0, 20.0)
    own = aircraft.aerodynamics
    assert own is not None
    quantities = SimpleNamespace(airspeed=60.0, alpha=np.radians(5.0), q=0.0, delta_e=0.2)
    found = {name: float(ca.evalf(ca.SX(value))) for name, value in own(quantities).items()}
    cz = 0.25 * (0.75 * 0.1 + 0.25 * -1.5) + 0.75 * (0.75 * -0.1 + 0.25 * -1.9)
    assert found["CZ"] == pytest.approx(cz)
    assert found["Cm"] == pytest.approx(2.0 * 25.0 + 0.2 * cz / 2.0)
    aircraft.write(tmp_path / "plane.toml")
    assert cs.Aircraft.read(tmp_path / "plane.toml") == aircraft


@pytest.mark.parametrize(
    ("math", "expected"),
    [
        ("<apply><minus/><ci>de</ci></apply>", -0.2),
        ("<apply><divide/><cn>1</cn><apply><plus/><cn>3</cn><cn>1</cn></apply></apply>", 0.25),
        ("<apply><power/><cn>2</cn><cn>3</cn></apply>", 8.0),
        ("<apply><max/><cn>2</cn><apply><abs/><cn>-3</cn></apply></apply>", 3.0),
        (
            "<apply><piecewise><piece><cn>1</cn><apply><lt/><ci>al</ci><cn>0</cn></apply></piece>"
            "<piece><cn>2</cn><apply><lt/><ci>al</ci><cn>9</cn></apply></piece>"
            "<otherwise><cn>3</cn></otherwise></piecewise></apply>",
            2.0,
        ),
        ("<cn> 17.5 </cn>", 17.5),  # numbers of MathML 2, 4.4.1
        ('<cn type="integer">-12</cn>', -12.0),
        ('<cn type="e-notation">1.25<sep/>-3</cn>', 1.25e-3),
        ('<cn type="rational">1<sep/>-8</cn>', -0.125),
        ('<cn base="10">10</cn>', 10.0),
    ],
)
def test_operators(tmp_path: Path, math: str, expected: float) -> None:
    aero, _ = written(tmp_path, math)
    look = dave_file(aero.read_text()).values({"al": ca.SX(5.0), "de": ca.SX(0.2)})
    assert float(ca.evalf(ca.SX(look("cm")))) == pytest.approx(expected)


@pytest.mark.parametrize(("al", "expected"), [(-5.0, 0.5), (1.0, 1.0), (5.0, 2.0)])
def test_a_variable_stays_within_its_limits(tmp_path: Path, al: float, expected: float) -> None:
    """The standard: the final value of the variable is limited, of an input and of a calculation."""
    aero, _ = written(tmp_path, "<ci>al</ci>")
    text = aero.read_text().replace('varID="cm"', 'varID="cm" minValue="0.5"')
    look = dave_file(text.replace('varID="al"', 'varID="al" maxValue="2"', 1)).values({"al": ca.SX(al)})
    assert float(ca.evalf(ca.SX(look("cm")))) == expected


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"math": "<apply><factorial/><ci>al</ci></apply>"}, "<factorial> of 1 arguments is no operator"),
        ({"math": "<ci>alfa</ci>"}, "unknown variable 'alfa'; did you mean 'al'"),
        ({"math": "<ci>cm</ci>"}, "'cm' depends on itself"),
        ({"math": '<cn base="16">10</cn>'}, "base 16: only numbers of base 10"),
        ({"math": '<cn type="complex-cartesian">1<sep/>2</cn>'}, "type 'complex-cartesian' is not read"),
        ({"math": '<cn type="e-notation">1.25</cn>'}, "one <sep/> between them"),
        ({"math": '<cn type="e-notation">1<sep/>2.5</cn>'}, "must be a number, got '1e2.5'"),
        ({"math": '<cn type="rational">1<sep/>0</cn>'}, "divided by zero"),
        ({"math": "<cn>1<sep/>2</cn>"}, "must be a number alone"),
        ({"math": "<cn>1_0</cn>"}, "must be a number, got '1_0'"),
        ({"math": "<cn>\u0661\u0662</cn>"}, "must be a number, got"),
        ({"more": '<variableDef name="flap" varID="cm" units="deg"/>'}, "two of <variableDef> have varID 'cm'"),
        ({"more": '<variableDef name="aeroBodyForceCoefficient_Z" varID="z" initialValue="0"/>'}, "both called"),
        ({"more": '<breakpointDef bpID="A"><bpVals>0, 1</bpVals></breakpointDef>'}, "<breakpointDef> have bpID 'A'"),
        ({"beyond": "min"}, "one way beyond its table"),
        ({"beyond": 'neither" interpolate="cubicSpline'}, "linear between all of its breakpoints"),
        ({"beyond": 'neither" min="0.1'}, "linear between all of its breakpoints"),
        ({"beyond": 'neither" scale="2'}, "unknown attribute of <independentVarRef> 'scale'"),
        ({"math": "<cn>1</cn><cn>2</cn>"}, "<math> has 2 elements"),
        ({"math": "<piecewise><piece><cn>1</cn></piece></piecewise>"}, "<piece> has 1 elements"),
        ({"math": "<apply><plus/>2<cn>1</cn></apply>"}, "<apply> has '2' beside its elements"),
        ({"more": '<breakpointDef bpID="B"><bpVals>0</bpVals><bpVals>1</bpVals></breakpointDef>'}, "2 of <bpVals>"),
        ({"more": '<variableDef name="flap" varID="df" unit="deg"/>'}, "unknown attribute of <variableDef> 'unit'"),
        ({"more": '<variableDef name="flap" varID="df" units="nd"><input/></variableDef>'}, "element of <variableDef>"),
        ({"more": '<variableDef name="flap" varID="df" units="deg"><isInput/></variableDef>'}, "input 'flap' is in no"),
    ],
)
def test_what_cannot_be_read_is_named(tmp_path: Path, changed: dict[str, str], message: str) -> None:
    aero, inertia = written(tmp_path, **changed)
    with pytest.raises(InputError, match=message) as caught:
        cs.aircraft_model(cs.Aircraft.from_daveml(aero, inertia))
    assert "plane.dml" in str(caught.value) and "\n" not in str(caught.value)
