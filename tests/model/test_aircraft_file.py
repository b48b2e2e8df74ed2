"""The aircraft file. Truth: the text of the public format, its written-out defaults, and the round trip."""

import pickle
import tomllib
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from casid.errors import InputError
from casid.model.aircraft import AXES_COEFFICIENTS, Aircraft, EffectValue, Inertia
from casid.model.terms import VARIABLES, Term
from casid.model.vocabulary import KINDS

DO328 = """
[aircraft]
name = "Do 328-100, cruise"
mass = 10500.0
inertia = { Ixx = 103000.0, Iyy = 158000.0, Izz = 240000.0, Ixz = 12500.0 }
gravity = 9.80665
[reference]
area = 40.0
moment_length = { lateral = 10.4, pitch = 2.04 }
rate_length   = { lateral = 10.4, pitch = 2.04 }
[propulsion]
thrust_line_z = 0.1
engine_y = [-2.5, 2.5]
[sensors]
accelerometer = [1.0, 0.0, 0.0]
alpha_vane = [5, 0.5, 0.0]
beta_vane = [0.0, 0.0, 0.0]
[sensors.noise]
alpha = 0.0035
[trim]
V = 144.0
altitude = 3200
[aerodynamics]
force_axes = "wind"
relative_uncertainty = 0.3
[aerodynamics.derivatives]
CL_0 = 0.221
CL_alpha = 6.0
Cm_delta_e = -1.93
[aerodynamics.terms]
Cm = { "alpha^2" = 0.5, "beta*alpha" = 0.0 }
[[effects]]
kind = "actuator_lag"
target = "delta_e"
value = 0.15
std = 0.01
unit = "s"
[[effects]]
kind = "configuration_change"
target = "CL+CD"
value = 0.1
parameters = { CD = 0.02 }
records = ["m1", "m3"]
onset_s = { m1 = [9.0, 9.4] }
"""


@pytest.fixture
def read(tmp_path):
    def read(text):
        path = tmp_path / "plane.toml"
        path.write_text(text, encoding="utf-8")
        return Aircraft.read(path)

    return read


def test_reads_the_format(read):
    plane = read(DO328)
    assert (plane.name, plane.mass, plane.gravity, plane.area) == ("Do 328-100, cruise", 10500.0, 9.80665, 40.0)
    assert plane.inertia == Inertia(Ixx=103000.0, Iyy=158000.0, Izz=240000.0, Ixz=12500.0)
    assert (plane.moment_length_lateral, plane.rate_length_pitch) == (10.4, 2.04)
    assert (plane.thrust_line_z, plane.engine_y, plane.alpha_vane) == (0.1, (-2.5, 2.5), (5.0, 0.5, 0.0))
    assert plane.noise == {"alpha": 0.0035} and plane.trim == {"V": 144.0, "altitude": 3200.0}
    assert (plane.force_axes, plane.relative_uncertainty) == ("wind", 0.3)
    assert plane.derivatives == {"CL_0": 0.221, "CL_alpha": 6.0, "Cm_delta_e": -1.93}
    assert plane.terms == {"Cm": {"alpha^2": 0.5, "alpha*beta": 0.0}}
    lag, step = plane.effects
    assert (lag.kind, lag.target, lag.value, lag.std, lag.unit, lag.onset_s) == (
        "actuator_lag",
        "delta_e",
        0.15,
        0.01,
        "s",
        None,
    )
    assert (step.records, step.onset_s, step.parameters) == (("m1", "m3"), {"m1": (9.0, 9.4)}, {"CD": 0.02})


def test_lengths_from_span_and_chord_are_full_for_moments_and_half_for_rates(read):
    lines = [line for line in DO328.splitlines() if "_length" not in line]
    plane = read("\n".join(lines).replace("area = 40.0", "area = 40.0\nspan = 20.8\nchord = 2.04"))
    assert (plane.moment_length_lateral, plane.moment_length_pitch) == (20.8, 2.04)
    assert (plane.rate_length_lateral, plane.rate_length_pitch) == (10.4, 1.02)


MINIMAL = """
[aircraft]
mass = 1000
inertia = { Ixx = 1.0, Iyy = 1.0, Izz = 1.0, Ixz = 0.0 }
[reference]
area = 10
span = 8
chord = 1
[aerodynamics.derivatives]
Cm_alpha = -1
"""


def test_what_the_format_calls_optional_may_be_absent(read):
    plane = read(MINIMAL)
    assert (plane.name, plane.gravity, plane.force_axes, plane.relative_uncertainty) == ("plane", 9.80665, "wind", 0.0)
    assert plane.accelerometer == (0.0, 0.0, 0.0) and not plane.noise and not plane.trim and not plane.effects


FAULTS = [
    ("mass = 10500.0", "mas = 10500.0", "[aircraft]: unknown key 'mas'; did you mean 'mass'"),
    ("mass = 10500.0", "", "[aircraft]: 'mass' is missing"),
    ("mass = 10500.0", "mass = -3", "'mass' is -3; expected a positive number"),
    ("mass = 10500.0", "mass = 0", "'mass' is 0; expected a positive number"),
    ("mass = 10500.0", "mass = nan", "'mass' is nan; expected a positive number"),
    ("mass = 10500.0", "mass = true", "'mass' is True; expected a positive number"),
    ("mass = 10500.0", 'mass = "10 parsec"', "'10 parsec'; expected a number, or one with a unit"),
    ("mass = 10500.0", f"mass = 1{400 * '0'}", "'mass' is a number too large; expected a positive number"),
    ("mass = 10500.0", f"mass = 1{5000 * '0'}", "not valid TOML"),
    ("mass = 10500.0", "mass = ", "not valid TOML"),
    ("Ixz = 12500.0", "Ixz = 160000.0", "not positive definite"),
    ("Ixx = 103000.0", "Ixx = -1.0", "inertia: 'Ixx' is -1; expected a positive number"),
    (", Ixz = 12500.0", "", "[aircraft] inertia: 'Ixz' is missing"),
    ("Ixz = 12500.0", "Ixq = 12500.0", "[aircraft] inertia: unknown key 'Ixq'"),
    ("area = 40.0", "area = 0.0", "'area' is 0; expected a positive number"),
    ("area = 40.0", "aera = 40.0", "[reference]: unknown key 'aera'; did you mean 'area'"),
    ("moment_length = { lateral = 10.4, pitch = 2.04 }", "", "give moment_length = { lateral = ... } or 'span'"),
    ("moment_length = { lateral = 10.4, pitch = 2.04 }", "moment_length = 3", "'moment_length' is 3; expected a table"),
    ("[propulsion]", "[propulsoin]", "unknown key 'propulsoin'; did you mean 'propulsion'"),
    ("accelerometer = [1.0, 0.0, 0.0]", "accelerometer = [1.0, 0.0]", "expected a list of 3 numbers"),
    ("alpha = 0.0035", "alhpa = 0.0035", "noise: unknown channel 'alhpa'; did you mean 'alpha'"),
    ("alpha = 0.0035", "alpha = 0.0", "noise: 'alpha' is 0; expected a positive number"),
    ("altitude = 3200", "height = 3200", "trim: unknown key 'height'"),
    ('"wind"', '"winds"', "unknown force_axes 'winds'; did you mean 'wind'"),
    ('"wind"', '"accelerations"', "unknown force_axes 'accelerations'; expected one of: body, wind"),
    ('"wind"', '"body"', "'CL_0': 'CL' belongs to force_axes = \"wind\""),
    ("relative_uncertainty = 0.3", "relative_uncertainty = -0.3", "is -0.3; expected a number from 0 on"),
    ("Cm_delta_e = -1.93", "Cm_delta_le = -1.93", "unknown derivative 'Cm_delta_le'; did you mean 'Cm_delta_e'"),
    ("Cm_delta_e = -1.93", "Cmde = -1.93", "unknown derivative 'Cmde'"),
    ("Cm_delta_e = -1.93", "CX_alpha = -1.93", "'CX' belongs to force_axes = \"body\""),
    ("Cm_delta_e = -1.93", '"Cm_alpha^3" = -1.93', 'not linear; write it under terms as Cm = { "alpha^3" = -1.93 }'),
    ('"alpha^2" = 0.5', '"alpah^2" = 0.5', "unknown variable 'alpah'; did you mean 'alpha'"),
    ('"alpha^2" = 0.5', '"alpha**2" = 0.5', "not a monomial"),
    ('"alpha^2" = 0.5', '"alpha*beta" = 0.5', "'beta*alpha' stands twice, as Cm_alpha*beta"),
    ('"alpha^2" = 0.5', '"delta_e" = 0.5', "'delta_e' stands twice, as Cm_delta_e"),
    ("[[effects]]", "[aerodynamics.std]\nCm_delta_r = 0.1\n[[effects]]", "'Cm_delta_r'; did you mean 'Cm_delta_e'"),
    ("[[effects]]", "[aerodynamics.std]\nCL_0 = -0.1\n[[effects]]", "std: 'CL_0' is -0.1; expected a number from 0 on"),
    ('kind = "actuator_lag"', 'kind = "actuator_leg"', "[[effects]] number 1: unknown effect kind 'actuator_leg'"),
    ('target = "delta_e"', 'target = "delta_x"', "unknown target of 'actuator_lag' 'delta_x'"),
    ('unit = "s"', 'unit = "ms"', "unit is the text 'ms'; expected 's'"),
    ("value = 0.15", "", "[[effects]] number 1: 'value' is missing"),
    ("value = 0.15", "vale = 0.15", "unknown key 'vale'; did you mean 'value'"),
    ("std = 0.01", "std = -0.01", "std is -0.01; expected a number from 0 on"),
    ('records = ["m1", "m3"]', 'records = "m1"', "records is the text 'm1'; expected a list of names"),
    ("m1 = [9.0, 9.4]", "m1 = [9.5, 9.4]", "runs backwards"),
    ("m1 = [9.0, 9.4]", "m2 = [9.0, 9.4]", "onset_s: unknown record 'm2'"),
    ('"CL+CD"', '"CX+CD"', "'CX' belongs to force_axes = \"body\""),
]


@pytest.mark.parametrize(("good", "bad", "message"), FAULTS)
def test_a_fault_is_one_line_that_names_file_place_and_remedy(read, good, bad, message):
    assert good in DO328
    with pytest.raises(InputError) as caught:
        read(DO328.replace(good, bad, 1))
    line = str(caught.value)
    assert message in line and "plane.toml" in line and "\n" not in line


def test_a_missing_file_is_an_input_error(tmp_path):
    with pytest.raises(InputError, match="cannot be read"):
        Aircraft.read(tmp_path / "nowhere.toml")


def test_an_impossible_body_is_noted():
    assert not Inertia(Ixx=103000.0, Iyy=158000.0, Izz=240000.0, Ixz=12500.0).notes
    assert not Inertia(Ixx=1.0, Iyy=1.0, Izz=2.0, Ixz=0.0).notes  # a flat plate is the limit
    assert "no rigid body" in Inertia(Ixx=1.0, Iyy=1.0, Izz=2.1, Ixz=0.0).notes[0]


NUMBER = st.floats(allow_nan=False, allow_infinity=False)
POSITIVE = st.floats(1e-300, 1e300)
TEXT = st.text(st.characters(exclude_categories=["C", "Z"]), max_size=20)
KEY = st.from_regex(r"[A-Za-z_][A-Za-z0-9_]*", fullmatch=True)
POINT = st.tuples(NUMBER, NUMBER, NUMBER)
NONLINEAR = st.dictionaries(st.sampled_from(VARIABLES), st.integers(1, 9), min_size=2, max_size=3).map(
    lambda powers: Term(factors=tuple((v, powers[v]) for v in VARIABLES if v in powers)).name
)


@st.composite
def effects(draw, axes):
    coefficients = AXES_COEFFICIENTS[axes]
    of_a_file = [k for k in sorted(KINDS) if KINDS[k].place not in ("equation", "value")]
    kind = KINDS[draw(st.sampled_from([k for k in of_a_file if KINDS[k].targets or not KINDS[k].of_rotors]))]
    target = (
        draw(st.sampled_from([t for t in kind.targets if t[0] != "C" or t in coefficients])) if kind.targets else ""
    )
    onset = st.tuples(NUMBER, NUMBER).map(lambda pair: (min(pair), max(pair)))
    return EffectValue(
        kind=kind.kind,
        target=target,
        term=draw(st.sampled_from(kind.terms) if kind.terms else NONLINEAR) if kind.needs_term else None,
        value=draw(NUMBER),
        std=draw(st.floats(0.0, 1e300)),
        parameters=draw(st.dictionaries(KEY, NUMBER, max_size=2)),
        onset_s=draw(st.none() | st.dictionaries(TEXT, onset, max_size=2)),
        sentence=draw(TEXT),
    )


@st.composite
def planes(draw):
    axes = draw(st.sampled_from(["body", "wind"]))
    linear = [f"{c}_{v}" for c in AXES_COEFFICIENTS[axes] for v in ("0", *VARIABLES)]
    derivatives = draw(st.dictionaries(st.sampled_from(linear), NUMBER, min_size=1, max_size=5))
    terms = draw(st.dictionaries(st.sampled_from(AXES_COEFFICIENTS[axes]), st.dictionaries(NONLINEAR, NUMBER)))
    named = [*derivatives, *(f"{c}_{term}" for c, row in terms.items() for term in row)]
    return Aircraft(
        name=draw(TEXT),
        mass=draw(POSITIVE),
        inertia=Inertia(Ixx=draw(POSITIVE), Iyy=1.0, Izz=draw(POSITIVE), Ixz=0.0),
        gravity=draw(POSITIVE),
        area=draw(POSITIVE),
        moment_length_lateral=draw(POSITIVE),
        moment_length_pitch=draw(POSITIVE),
        rate_length_lateral=draw(POSITIVE),
        rate_length_pitch=draw(POSITIVE),
        thrust_line_z=draw(NUMBER),
        engine_y=tuple(draw(st.lists(NUMBER, max_size=4))),
        accelerometer=draw(POINT),
        noise=draw(st.dictionaries(st.sampled_from(["alpha", "q", "ax"]), POSITIVE)),
        trim=draw(st.dictionaries(st.sampled_from(["V", "rho", "gravity"]), POSITIVE)),
        force_axes=axes,
        relative_uncertainty=draw(st.floats(0.0, 1.0)),
        derivatives=derivatives,
        terms=terms,
        std=draw(st.dictionaries(st.sampled_from(named), st.floats(0.0, 1e300))),
        effects=tuple(draw(st.lists(effects(axes), max_size=3))),
    )


@given(planes())
def test_what_is_written_is_read_back_equal(tmp_path_factory, plane):
    path = tmp_path_factory.mktemp("planes") / "plane.toml"
    plane.write(path)
    again = Aircraft.read(path)
    assert again == plane
    assert list(again.derivatives) == list(plane.derivatives)
    assert list(tomllib.loads(path.read_text(encoding="utf-8")))[:2] == ["aircraft", "reference"]


@settings(max_examples=300)
@given(st.data())
def test_a_mutilated_file_is_an_aircraft_or_an_input_error(tmp_path_factory, data):
    content = bytearray(DO328.encode())
    for _ in range(data.draw(st.integers(1, 3))):
        at = data.draw(st.integers(0, len(content) - 1))
        content[at : at + data.draw(st.integers(0, 20))] = data.draw(st.binary(max_size=4))
    path = tmp_path_factory.mktemp("planes") / "plane.toml"
    path.write_bytes(content)
    try:
        Aircraft.read(path)
    except InputError as error:
        assert "\n" not in str(error)


def test_changes_make_a_new_aircraft(read):
    plane = read(MINIMAL)
    changed = plane.with_derivatives({"Cm_alpha": -2.0, "Cm_q": -9.0}).with_terms({"Cm": {"beta*alpha": 1.0}})
    changed = changed.with_terms({"Cm": {"alpha*beta": 2.0, "alpha^2": 3.0}})
    lag = EffectValue(kind="actuator_lag", target="delta_e", value=0.1)
    assert changed.with_effects([lag]).with_effects([lag]).effects == (lag, lag)
    assert changed.derivatives == {"Cm_alpha": -2.0, "Cm_q": -9.0}
    assert changed.terms == {"Cm": {"alpha*beta": 2.0, "alpha^2": 3.0}}
    assert plane == read(MINIMAL)


def test_travels_between_processes(read):
    plane = read(DO328)
    assert pickle.loads(pickle.dumps(plane)) == plane


def test_a_new_file_keeps_the_comments_of_the_old(tmp_path):
    """Comments, order and unchanged lines stay to the letter; the result reads back equal."""
    commented = "# my plane\n" + DO328.replace("mass = 10500.0", "mass = 10500.0  # weighed in May")
    (tmp_path / "old.toml").write_text(commented)
    plane = Aircraft.read(tmp_path / "old.toml")
    changed = replace(plane, mass=10400.0).with_effects([EffectValue(kind="actuator_lag", target="delta_e", value=0.1)])
    changed.write(tmp_path / "new.toml", like=tmp_path / "old.toml")
    new = (tmp_path / "new.toml").read_text()
    assert Aircraft.read(tmp_path / "new.toml") == changed
    assert "mass = 10400.0  # weighed in May" in new and new.startswith("# my plane\n") and "gravity = 9.80665\n" in new
    order = [line for line in commented.splitlines() if line.startswith("[") and not line.startswith("[[")]
    assert [line for line in new.splitlines() if line in order] == order


US_PLANE = """
[aircraft]
mass = "6000 lb"        # from the manual
inertia = { Ixx = "3.2e4 slug ft2", Iyy = "2.0e4 slug-ft^2", Izz = 60000.0, Ixz = "1000 lb*ft2" }
[reference]
area = "300 ft²"
span = "40 ft"
chord = "90 in"
[aerodynamics.derivatives]
CL_0 = 0.3
CL_alpha = 5.0
"""


def test_mass_and_inertia_with_units(tmp_path):
    """By definition: 1 lb = 0.45359237 kg, 1 ft = 0.3048 m, 1 slug = 1 lbf s2/ft = 14.59390 kg."""
    slug = 0.45359237 * 9.80665 / 0.3048
    path = tmp_path / "us.toml"
    path.write_text(US_PLANE, encoding="utf-8")
    plane = Aircraft.read(path)
    assert plane.mass == pytest.approx(6000 * 0.45359237, rel=1e-12)
    inertia = [plane.inertia.Ixx, plane.inertia.Iyy, plane.inertia.Izz, plane.inertia.Ixz]
    feet2 = 0.3048**2
    assert inertia == pytest.approx([3.2e4 * slug * feet2, 2e4 * slug * feet2, 6e4, 1e3 * 0.45359237 * feet2])
    assert plane.area == pytest.approx(300 * feet2) and plane.moment_length_lateral == pytest.approx(40 * 0.3048)
    assert plane.rate_length_pitch == pytest.approx(0.5 * 90 * 0.0254)
    plane.write(tmp_path / "si.toml")
    assert Aircraft.read(tmp_path / "si.toml") == replace(plane, name=plane.name)


def test_units_stay_in_the_file_when_it_is_written_again(tmp_path):
    path = tmp_path / "us.toml"
    path.write_text(US_PLANE, encoding="utf-8")
    plane = Aircraft.read(path)
    heavier = replace(plane, mass=2.0 * plane.mass)
    heavier.write(tmp_path / "new.toml", like=path)
    text = (tmp_path / "new.toml").read_text(encoding="utf-8")
    assert 'mass = "12000.0 lb"        # from the manual' in text and '"3.2e4 slug ft2"' in text
    again = Aircraft.read(tmp_path / "new.toml")
    assert again.mass == pytest.approx(heavier.mass, rel=1e-15)
    assert again.inertia == heavier.inertia and again.area == heavier.area


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('"6000 lb"', '"6000 lbf"', "[aircraft] mass is the text '6000 lbf'; did you mean 'lb'?"),
        ('"6000 lb"', '"heavy"', "[aircraft] mass is the text 'heavy'; expected a number, or one with a unit: kg, lb"),
        ('"3.2e4 slug ft2"', '"3.2e4 slug"', "[aircraft] inertia: Ixx is the text '3.2e4 slug'"),
        ('"40 ft"', '"40 m2"', "[reference] span is the text '40 m2'"),
    ],
)
def test_a_unit_that_does_not_fit(tmp_path, old, new, message):
    path = tmp_path / "us.toml"
    path.write_text(US_PLANE.replace(old, new), encoding="utf-8")
    with pytest.raises(InputError) as caught:
        Aircraft.read(path)
    assert message in str(caught.value) and "us.toml" in str(caught.value)
