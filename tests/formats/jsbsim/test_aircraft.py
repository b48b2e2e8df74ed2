"""A JSBSim file read by casid computes what JSBSim computes with it."""

from __future__ import annotations

import re
from pathlib import Path
from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest

import casid as cs
from casid.errors import InputError
from casid.formats.jsbsim.aircraft import mass_properties
from casid.formats.jsbsim.source import load
from casid.signals import FOOT, SLUG
from problems.jsbsim.agreement import compare, file_of, gliding, rig

pytest.importorskip("jsbsim")

PLANE = """<?xml version="1.0"?>
<fdm_config name="brick" version="2.0">
  <metrics>
    <wingarea unit="M2"> 10 </wingarea><wingspan unit="M"> 8 </wingspan><chord unit="M"> 1.25 </chord>
    <location name="AERORP" unit="M"><x> 2.0 </x><y> 0 </y><z> 0.5 </z></location>
  </metrics>
  <mass_balance>
    <ixx unit="KG*M2"> 1000 </ixx><iyy unit="KG*M2"> 2000 </iyy><izz unit="KG*M2"> 2500 </izz>
    <ixz unit="KG*M2"> -50 </ixz>
    <emptywt unit="KG"> 800 </emptywt>
    <location name="CG" unit="M"><x> 2.0 </x><y> 0 </y><z> 0 </z></location>
    <pointmass name="pilot"><weight unit="KG"> 200 </weight>
      <location unit="M"><x> 1.0 </x><y> 0 </y><z> 1.0 </z></location></pointmass>
  </mass_balance>
  <aerodynamics>
    {functions}
    <axis name="LIFT"><function name="aero/force/lift"><product>
      <property>aero/qbar-psf</property><property>metrics/Sw-sqft</property>{lift}</product></function></axis>
  </aerodynamics>
</fdm_config>
"""


def plane(folder: Path, lift: str, functions: str = "") -> Path:
    path = folder / "brick.xml"
    path.write_text(PLANE.format(lift=lift, functions=functions))
    return path


def lift_at(path: Path, **values: float) -> float:
    """CL of the file at the quantities given."""
    own = cs.Aircraft.from_jsbsim(path).aerodynamics
    assert own is not None
    names = ("alpha", "beta", "p", "q", "r", "delta_e", "delta_a", "delta_r", "mach", "airspeed", "qbar", "rho")
    given = {"airspeed": 50.0, "qbar": 1500.0, "rho": 1.2} | values
    found = own(SimpleNamespace(**{name: ca.SX(given.get(name, 0.0)) for name in names}))
    return float(ca.evalf(found["CL"]))


@pytest.mark.parametrize("name", ["737", "c310", "f16", "c172r", "T37"])
def test_coefficients_and_rates_are_those_of_jsbsim(name: str) -> None:
    """All of them to 1e-6, at random states (scripts/check_jsbsim.py: every stock aircraft, 1000 states)."""
    found = compare(rig(name), states=15, seed=2)
    assert found.coefficients < 1e-10
    assert found.rates < 1e-6


def test_a_glide_is_that_of_jsbsim() -> None:
    """States of 20 s differ by less than 1e-3 of their range, and by less still when JSBSim takes finer steps."""
    one = rig("737")
    apart = []
    for rate in (100, 400):
        theirs, ours = gliding(one, rate, 20.0)
        apart.append(np.max(np.abs(ours - theirs).max(axis=0) / np.ptp(theirs, axis=0)))
    assert apart[1] < 1e-3
    assert apart[1] < 0.5 * apart[0]


def test_mass_properties_are_added_up() -> None:
    """Of every aircraft with tanks, point masses of every form and negated products of inertia, as JSBSim has them."""
    one = rig("c310")
    fdm, mass = one.fdm, mass_properties(load(file_of("c310")))
    fdm.run_ic()
    assert mass.weight / 32.174049 == pytest.approx(fdm["inertia/mass-slugs"], rel=1e-12)
    assert one.aircraft.mass == pytest.approx(fdm["inertia/mass-slugs"] * SLUG, rel=1e-12)
    for pair, (i, j) in {"xx": (0, 0), "yy": (1, 1), "zz": (2, 2), "xz": (0, 2)}.items():
        assert mass.inertia[i, j] == pytest.approx(fdm[f"inertia/i{pair}-slugs_ft2"], rel=1e-9, abs=1e-9)


def test_units_and_places_of_a_small_file(tmp_path: Path) -> None:
    """Two masses on an arm: c.g. between them, inertia by Steiner; lift above the c.g. behind it."""
    aircraft = cs.Aircraft.from_jsbsim(plane(tmp_path, "<value>1.0</value>"))
    assert aircraft.mass == pytest.approx(1000.0, rel=1e-6)
    assert (aircraft.area, aircraft.moment_length_lateral) == pytest.approx((10.0, 8.0), rel=1e-12)
    arm = 800.0 * 200.0 / 1000.0  # reduced mass, at a distance of sqrt(2) m, 1 m along x and along z
    assert aircraft.inertia.Iyy == pytest.approx(2000.0 + 2.0 * arm, rel=1e-6)
    assert aircraft.inertia.Ixx == pytest.approx(1000.0 + arm, rel=1e-6)
    # products negated by default: the file's -50 is the tensor's element, and so Ixz = +50, the masses add theirs
    assert abs(aircraft.inertia.Ixz - 50.0) == pytest.approx(arm, rel=1e-5)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("<sum><value>1</value><value>2</value><value>4</value></sum>", 7.0),
        ("<difference><value>7</value><value>2</value><value>1</value></difference>", 4.0),
        ("<quotient><value>7</value><value>2</value></quotient>", 3.5),
        ("<pow><value>2</value><value>3</value></pow>", 8.0),
        ("<abs><property>-velocities/mach</property></abs>", 0.5),
        ("<sqrt><value>9</value></sqrt>", 3.0),
        ("<atan2><value>1</value><value>-1</value></atan2>", 2.356194490192345),
        ("<min><value>4</value><value>-1</value></min>", -1.0),
        ("<avg><value>4</value><value>-1</value></avg>", 1.5),
        ("<toradians><value>180</value></toradians>", 3.141592653589793),
        ("<ifthen><lt><property>velocities/mach</property><v>0.6</v></lt><v>2</v><v>3</v></ifthen>", 2.0),
        ("<ifthen><and><gt><p>velocities/mach</p><v>0</v></gt><v>0</v></and><v>2</v><v>3</v></ifthen>", 3.0),
        ("<property>aero/alpha-deg</property>", 5.729577951308232),
        ("<property>velocities/vt-fps</property>", 50.0 / FOOT),
    ],
)
def test_operators_of_a_function(tmp_path: Path, text: str, expected: float) -> None:
    assert lift_at(plane(tmp_path, text), mach=0.5, alpha=0.1) == pytest.approx(expected, rel=1e-12)


def test_tables_of_one_to_three_dimensions(tmp_path: Path) -> None:
    """Linear between breakpoints and held beyond them; pages of a third dimension may have breakpoints of their own."""
    one = """<table><independentVar>aero/alpha-rad</independentVar>
      <tableData> 0.0 1.0
                  0.2 3.0 </tableData></table>"""
    assert lift_at(plane(tmp_path, one), alpha=0.05) == pytest.approx(1.5)
    assert lift_at(plane(tmp_path, one), alpha=0.5) == pytest.approx(3.0)
    both = '<independentVar lookup="{}">{}</independentVar>'
    row, column = both.format("row", "aero/alpha-rad"), both.format("column", "velocities/mach")
    two = f"<table>{row}{column}<tableData>  0.0 1.0\n 0.0 1.0 2.0\n 0.2 3.0 8.0</tableData></table>"
    assert lift_at(plane(tmp_path, two), alpha=0.1, mach=0.5) == pytest.approx(3.5)
    page = both.format("table", "aero/beta-rad")
    three = f"""<table>{row}{column}{page}
      <tableData breakPoint="0.0">  0.0 1.0\n 0.0 1.0 2.0\n 0.2 3.0 8.0</tableData>
      <tableData breakPoint="0.1">  0.0 0.5 1.0\n 0.0 1.0 1.0 1.0\n 0.1 1.0 1.0 1.0\n 0.2 1.0 1.0 1.0</tableData>
      </table>"""
    # between the pages at a quarter; casid's CL is about the stability axes, as JSBSim's lift is
    assert lift_at(plane(tmp_path, three), alpha=0.1, mach=0.5, beta=0.025) == pytest.approx(0.75 * 3.5 + 0.25)


@pytest.mark.parametrize(
    ("lift", "message"),
    [
        ("<property>velocities/vc-kts</property>", "'velocities/vc-kts' is not known without JSBSim; hold it"),
        ("<random/>", "<random> with 0 arguments is no operator"),
        ("<value>ten</value>", "<value> must be a number, got 'ten'"),
        ("<table><tableData>1 2</tableData></table>", "no independentVar"),
        ("<property>aero/loop</property>", "'aero/loop' depends on itself"),
    ],
)
def test_what_cannot_be_read_is_named(tmp_path: Path, lift: str, message: str) -> None:
    loop = '<function name="aero/loop"><sum><property>aero/loop</property><v>1</v></sum></function>'
    with pytest.raises(InputError, match=message) as caught:
        cs.Aircraft.from_jsbsim(plane(tmp_path, lift, loop))
    assert "brick.xml" in str(caught.value) and "\n" not in str(caught.value)


AREA = '<wingarea unit="M2"> 10 </wingarea>'


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            AREA,
            '<wingarea unit="KG"> 10 </wingarea>',
            "<wingarea>: unit 'KG' is none of its quantity; expected FT2 or M2",
        ),
        (AREA, '<wingarea unit="FT2"> 17<b/>4.0 </wingarea>', "<wingarea> must be a number alone; it has <b>"),
        (AREA, "<wingarea> \u0661\u0667 </wingarea>", "<wingarea> must be a number, got"),
        (AREA, "<wingarea> 1_0 </wingarea>", "<wingarea> must be a number, got '1_0'"),
        (AREA, "<wingarea> 1e999 </wingarea>", "<wingarea> must be a number, got '1e999'"),
        (AREA, '<wingarea units="M2"> 10 </wingarea>', "unknown attribute of <wingarea> 'units'; did you mean 'unit'?"),
        ("<ixz ", "<izx/><ixz ", "unknown element of <mass_balance> 'izx'"),
        ('<location name="CG"', '<location name="CoG"', "<mass_balance>: unknown location 'CoG'"),
        ("<product>", "<product> 2 ", "<product> has '2' beside its elements"),
        ("<axis", "<axes/><axis", "unknown element of <aerodynamics> 'axes'; did you mean 'axis'?"),
        (AREA, AREA + AREA, "<metrics> has 2 of <wingarea>; keep the one that is meant"),
        ('<location unit="M">', '<location unit="LBS">', "<location>: unit 'LBS' is none of its quantity"),
        ("</axis>", '</axis><axis name="LIFT"/>', 'axis name="LIFT"> stands twice'),
        ('name="aero/force/lift"', 'name="aero/force/lift" apply_at_cg="true"', "applied at the c.g."),
        (
            "<mass_balance>",
            '<mass_balance negated_crossproduct_inertia="maybe">',
            "negated_crossproduct_inertia 'maybe'",
        ),
        ("<axis", "<function name='x'><v>1</v></function><function name='x'><v>2</v></function><axis", "called 'x'"),
    ],
)
def test_what_means_nothing_or_stands_twice_is_refused(tmp_path: Path, old: str, new: str, message: str) -> None:
    path = plane(tmp_path, "<v>0.1</v>")
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1), encoding="utf-8")
    with pytest.raises(InputError, match=re.escape(message)) as caught:
        cs.aircraft_model(cs.Aircraft.from_jsbsim(path))
    assert "brick.xml" in str(caught.value)


@pytest.mark.parametrize("text", ["", "<fdm_config", "<aircraft/>", "<fdm_config/>"])
def test_a_file_that_is_none_is_named(tmp_path: Path, text: str) -> None:
    (tmp_path / "plane.xml").write_text(text)
    with pytest.raises(InputError, match="plane.xml"):
        cs.Aircraft.from_jsbsim(tmp_path / "plane.xml")
    with pytest.raises(InputError, match="cannot be read"):
        cs.Aircraft.from_jsbsim(tmp_path / "none.xml")


def test_held_properties_are_said_and_act(tmp_path: Path) -> None:
    path = plane(tmp_path, "<property>fcs/flap-pos-deg</property>")
    assert "fcs/flap-pos-deg = 0" in cs.Aircraft.from_jsbsim(path).notes[-1]
    lowered = cs.Aircraft.from_jsbsim(path, held={"fcs/flap-pos-deg": 10.0})
    assert "fcs/flap-pos-deg = 10" in lowered.notes[-1]
    lowered.write(tmp_path / "brick.toml")
    assert cs.Aircraft.read(tmp_path / "brick.toml") == lowered
    assert cs.Aircraft.read(path) == cs.Aircraft.from_jsbsim(path)


def test_a_normalised_surface_is_made_of_the_recorded_one(tmp_path: Path) -> None:
    """Scales of the control system, forwards and, from a common input, backwards."""
    control = """<flight_control name="c"><channel name="pitch">
      <aerosurface_scale name="a"><input>fcs/stick</input><range><min>-0.4</min><max>0.2</max></range>
        <output>fcs/elevator-pos-rad</output></aerosurface_scale>
      <aerosurface_scale name="b"><input>fcs/stick</input><gain>10</gain><output>fcs/elevator-pos-norm</output>
      </aerosurface_scale></channel></flight_control>"""
    path = plane(tmp_path, "<property>fcs/elevator-pos-norm</property>")
    path.write_text(path.read_text().replace("</fdm_config>", control + "</fdm_config>"))
    assert lift_at(path, delta_e=0.1) == pytest.approx(5.0)
    assert lift_at(path, delta_e=-0.1) == pytest.approx(-2.5)


def test_a_term_turns_the_flow_as_a_derivative_does() -> None:
    """Lift and pitching moment of the c172p depend on alphadot: a force that a cause adds changes that, too.
    CL_alpha as an increment and as a cause are one and the same."""
    plain = cs.Aircraft.from_jsbsim(file_of("c172p"))
    term = cs.EffectValue(kind="aero_term", target="CL", term="alpha", value=2.0)
    found = []
    for aircraft in (plain, plain.with_derivatives({"CL_alpha": 2.0}), plain.with_effects([term])):
        model = cs.aircraft_model(aircraft)
        f = ca.Function("f", [model.x, model.u, model.p, model.w], [model.f])
        at = [{"delta_e": -0.03, "rho": 1.1}.get(name, 0.0) for name in model.inputs]
        state = (55.0, 2.0, 5.0, 0.1, 0.05, -0.04, 0.1, 0.1)
        found.append(f(state, at, model.nominal_vector(), np.zeros(len(model.disturbances))).full()[:, 0])
    without, derivative, cause = found
    assert np.abs(derivative - without).max() > 1.0
    np.testing.assert_allclose(cause - without, derivative - without, rtol=1e-9, atol=1e-12)
