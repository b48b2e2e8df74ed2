"""The vocabulary of effects: the truth is the table of `kind` and target in the public format."""

import ast
from pathlib import Path

import pytest

from casid.errors import InputError
from casid.model.aircraft import EffectValue
from casid.model.effects import effect_of
from casid.model.vocabulary import KINDS, check_effect, effect_sentence, effect_title, effect_unit

PUBLIC = {
    "aero_term",
    "unsteady_aero",
    "actuator_lag",
    "input_delay",
    "rate_limit",
    "dead_zone",
    "backlash",
    "effectiveness_change",
    "feedback",
    "stuck",
    "configuration_change",
    "sensor_bias",
    "sensor_scale",
    "sensor_delay",
    "sensor_lag",
    "vane_position",
    "accelerometer_position",
    "cg_offset",
    "mass",
    "moment_reference",
    "inertia",
    "thrust_asymmetry",
    "thrust_line",
    "wind_shear",
    "gust",
    "turbulence",
    "structural_mode",
    "table_increment",
    "sensor_misalignment",
    "position_error",
    "clock_drift",
    "thrust_scale",
    "added_mass",
    "battery_sag",
    "body_drag",
    "mass_change",
    "rotor_delay",
    "rotor_effectiveness",
    "rotor_inflow",
    "rotor_lag",
    "rotor_position",
    "rotor_swap",
    "rotor_torque",
    "thrust_curve",
    "second_order_actuator",
    "input_limit",
    "input_offset",
    "input_scale",
    "sample_hold",
    "sensor_stuck",
    "missing_term",
    "parameter_change",
    "dry_friction",
    "damping",
    "cross_damping",
    "relaxation",
    "inertia_scale",
    "parameter_split",
    "common_factor",
    "missing_derivative",
    "rotor_rise_fall",
    "rotor_limit",
    "rotor_tilt",
    "hysteresis",
    "sensor_resolution",
}
OF_ANY_MODEL = {kind for kind, entry in KINDS.items() if entry.place in ("equation", "value")}


def every_effect():
    for kind, entry in KINDS.items():
        if kind in OF_ANY_MODEL:
            continue
        targets = [*entry.targets, *([None] if entry.optional or not entry.targets else [])]
        if entry.of_rotors:
            targets = [*entry.targets, *(["m1+m2"] if entry.joined else ["m1", "rotors"])]
        for target in targets + (["CL+CD", "CL+CD+Cm"] if entry.joined and not entry.of_rotors else []):
            yield kind, target, (*entry.terms, "alpha^2")[0] if entry.needs_term else None


def test_the_kinds_are_those_of_the_public_format():
    assert set(KINDS) == PUBLIC


@pytest.mark.parametrize(("kind", "target", "term"), list(every_effect()))
def test_every_effect_has_unit_and_sentence(kind, target, term):
    check_effect(kind, target, term)
    assert effect_unit(kind, target, term) or (KINDS[kind].unit == "{channel}" and target in ("m1", "rotors"))
    sentence = effect_sentence(kind, target, term, 0.15)
    assert sentence.endswith(".") and not set("{[|]}") & set(sentence)


@pytest.mark.parametrize(("kind", "target", "term"), list(every_effect()))
def test_every_effect_of_an_aircraft_file_has_its_definition(kind, target, term):
    effect = effect_of(EffectValue(kind=kind, target=target or "", term=term, value=0.0))
    assert effect.key == (kind, target or "", term)
    assert not effect.regressor or effect.enters == f"d{effect.target}"


def named_kinds(source: str) -> list[str]:
    """Names of kinds in comparisons, lists, keywords `kind=` and tables; a key among others of a table is a plain word.

    "mass", "inertia" and "damping" are words of other things too.
    """
    kinds = PUBLIC - {"mass", "inertia", "damping"}
    found = []
    for node in ast.walk(ast.parse(source)):
        parts = []
        if isinstance(node, ast.Compare):
            parts = [node.left, *node.comparators]
        elif isinstance(node, ast.Tuple | ast.List | ast.Set):
            parts = node.elts
        elif isinstance(node, ast.keyword) and node.arg == "kind":
            parts = [node.value]
        elif isinstance(node, ast.Dict):
            parts = node.keys
        names = [part.value for part in parts if isinstance(part, ast.Constant) and part.value in kinds]
        found += names if not isinstance(node, ast.Dict) or len(names) > 1 else []
    return found


def test_no_kind_is_named_outside_its_definition():
    """What is to be known of a kind is asked of its definition.

    What JSBSim or another simulator has for a kind is a translation into its words, and the instrument errors of a
    check of compatibility are a list of its own.
    """
    package = Path(__file__).resolve().parents[2] / "casid"
    paths = [path for path in sorted(package.rglob("*.py")) if path.parent.name not in ("causes", "jsbsim", "formats")]
    paths = [path for path in paths if path.name != "compatibility.py"]
    wrong = {path.name: names for path in paths if (names := named_kinds(path.read_text(encoding="utf-8")))}
    assert not wrong
    for told in ('x.kind == "gust"', 'x in ("gust", "y")', 'f(kind="gust")', 'L = {"gust": 1, "cg_offset": 2}'):
        assert "gust" in named_kinds(told)


def test_titles_are_short_names_for_a_person():
    assert effect_title("actuator_lag", "delta_e", None) == "elevator: actuator lag"
    assert effect_title("aero_term", "Cm", "alpha^2") == "Cm: alpha^2"
    assert effect_title("wind_shear", "x", None) == "wind shear along x"
    assert effect_title("configuration_change", "CL+CD", None) == "CL, CD: configuration change"
    assert effect_title("sensor_delay", "inertial", None) == "inertial unit: sensor delay"
    assert effect_title("mass", "", None) == "mass"


def test_units_and_sentence_of_the_format_example():
    assert effect_unit("actuator_lag", "delta_e") == "s"
    assert effect_unit("aero_term", "CD", "alpha^2") == "1/rad2"
    assert effect_unit("sensor_bias", "qdot") == "rad/s2"
    assert effect_unit("structural_mode", "q") == "rad/s/rad"
    assert (
        effect_sentence("actuator_lag", "delta_e", None, 0.151)
        == "The elevator follows its command with a lag of 0.15 s that the model does not have."
    )


def test_angles_are_told_in_degrees_and_shares_in_percent():
    assert "off by 0.57 deg." in effect_sentence("sensor_bias", "alpha", None, 0.01)
    assert "by -30 % " in effect_sentence("effectiveness_change", "delta_r", None, -0.3)
    assert "by 840 kg " in effect_sentence("mass", None, None, 840.0)
    for value, which in ((0.7, "0.7 m to the right "), (-0.7, "0.7 m to the left ")):
        assert which in effect_sentence("thrust_asymmetry", None, None, value)
    for value, which in ((0.05, "0.05 s late."), (-0.05, "0.05 s early.")):
        assert effect_sentence("sensor_delay", "alpha", None, value).endswith(f"attack comes {which}")
        assert effect_sentence("sensor_delay", "surfaces", None, value).endswith(f"surfaces come {which}")


@pytest.mark.parametrize(
    ("kind", "target", "term", "message"),
    [
        ("actuator_lagg", "delta_e", None, "file: unknown effect kind 'actuator_lagg'; did you mean 'actuator_lag'"),
        ("actuator_lag", "elevatr", None, "unknown target of 'actuator_lag'"),
        ("actuator_lag", "delta_E", None, "did you mean 'delta_e'"),
        ("actuator_lag", None, None, "needs a target; expected one of: delta_e, delta_a, delta_r"),
        ("actuator_lag", "delta_e", "alpha", "has no term, got 'alpha'"),
        ("actuator_lag", "thrust", None, "unknown target"),
        ("aero_term", "CD", None, "needs a term"),
        ("aero_term", "CD", "alpah^2", "did you mean 'alpha'"),
        ("aero_term", "CL+CD", "alpha^2", "unknown target"),
        ("mass", "x", None, "has no target, got 'x'"),
        ("configuration_change", "CL+CL", None, "twice"),
        ("configuration_change", "CL+", None, "unknown target"),
        ("sensor_bias", "inertial", None, "unknown target"),
        ("gust", "w", None, "expected one of: x, y, z"),
        ("structural_mode", "V", None, "unknown target of 'structural_mode'"),
        ("inertia", "Ixy", None, "unknown target of 'inertia' 'Ixy'"),
    ],
)
def test_what_does_not_fit_is_an_error(kind, target, term, message):
    with pytest.raises(InputError) as caught:
        check_effect(kind, target, term, "file")
    assert message in str(caught.value) and "\n" not in str(caught.value)
