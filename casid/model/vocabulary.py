"""The vocabulary of effects: every `kind` of cause, its targets, its unit and its sentence.

One table for the aircraft file, the generator of hidden effects, the diagnosis and its report. The value of an effect
is a difference from the aircraft file or from a perfect instrument, in SI; zero means that the effect is absent
(a rate limit is absent when it is infinite).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from casid.errors import InputError, unknown
from casid.model.terms import COEFFICIENTS, parse_term
from casid.signals import SURFACES, label_of, unit_of

SENSOR_CHANNELS = (
    "V", "alpha", "beta", "p", "q", "r", "phi", "theta", "psi", "ax", "ay", "az", "pdot", "qdot", "rdot", "altitude",
)  # fmt: skip
# Channels that share one cause. `q` includes qdot; the inertial unit is all that it measures.
SENSOR_GROUPS: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {"inertial": ("p", "q", "r", "ax", "ay", "az", "pdot", "qdot", "rdot")}
)
AXES = ("x", "y", "z")
WIND_AXES = ("x", "y", "z", "u", "v", "w")

_UNIT_OF_TERM = "(of the term)"
_UNIT_OF_CHANNEL = "(of the channel)"
_UNIT_OF_CHANNEL_PER_SURFACE = "(of the channel)/rad"
_LABELS = {
    "CL": "lift", "CD": "drag", "CY": "side force", "CX": "longitudinal force", "CZ": "normal force",
    "Cl": "rolling moment", "Cm": "pitching moment", "Cn": "yawing moment", "inertial": "inertial unit",
}  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Kind:
    """One kind of cause.

    targets    valid targets; empty: it has none
    quantity   what its value is, with sign
    unit       SI unit of the value
    sentence   template; fields label, term, size, percent, target
    joined     the target is a set of `targets` that change together, written `CL+CD`
    optional   the target may be left out
    """

    kind: str
    targets: tuple[str, ...]
    quantity: str
    unit: str
    sentence: str
    needs_term: bool = False
    joined: bool = False
    optional: bool = False


def _kinds(*kinds: Kind) -> Mapping[str, Kind]:
    return MappingProxyType({kind.kind: kind for kind in kinds})


KINDS: Mapping[str, Kind] = _kinds(
    Kind(kind="aero_term", targets=COEFFICIENTS, needs_term=True, unit=_UNIT_OF_TERM,
         quantity="factor of the term",
         sentence="The {label} depends on {term} with a factor of {size}, a term that the model does not have."),
    Kind(kind="unsteady_aero", targets=COEFFICIENTS, unit="1/rad",
         quantity="derivative in the dimensionless rate of the angle of attack",
         sentence="The {label} depends on how fast the angle of attack changes ({size}), which the model leaves out."),
    Kind(kind="actuator_lag", targets=SURFACES, unit="s", quantity="time constant",
         sentence="The {label} follows its command with a lag of {size} that the model does not have."),
    Kind(kind="input_delay", targets=SURFACES, unit="s", quantity="delay of the surface behind its record",
         sentence="The {label} follows its command {size} late."),
    Kind(kind="rate_limit", targets=SURFACES, unit="rad/s", quantity="largest rate of the surface",
         sentence="The {label} cannot move faster than {size}."),
    Kind(kind="dead_zone", targets=SURFACES, unit="rad", quantity="half width around zero without any answer",
         sentence="The {label} does not answer to a command below {size}."),
    Kind(kind="backlash", targets=SURFACES, unit="rad", quantity="half the free play",
         sentence="The {label} has a free play of plus and minus {size}."),
    Kind(kind="effectiveness_change", targets=(*SURFACES, "thrust"), unit="1",
         quantity="relative change from the onset on; -0.3: 30 % are lost",
         sentence="The effectiveness of the {label} changes by {percent} in mid-record."),
    Kind(kind="configuration_change", targets=COEFFICIENTS, joined=True, unit="1",
         quantity="step of the first coefficient at the onset; the others stand in the parameters",
         sentence="The configuration changes in mid-record: a jump of {label}, {target} by {size}."),
    Kind(kind="sensor_bias", targets=SENSOR_CHANNELS, unit=_UNIT_OF_CHANNEL, quantity="measured minus true",
         sentence="The measured {label} is off by {size}."),
    Kind(kind="sensor_scale", targets=(*SENSOR_CHANNELS, *SENSOR_GROUPS), unit="1",
         quantity="relative error of the scale; 0.1: 10 % too large",
         sentence="The measured {label} has a scale error of {percent}."),
    Kind(kind="sensor_delay", targets=(*SENSOR_CHANNELS, *SENSOR_GROUPS), unit="s", quantity="delay",
         sentence="The measured {label} comes {size} late."),
    Kind(kind="sensor_lag", targets=(*SENSOR_CHANNELS, *SENSOR_GROUPS), unit="s", quantity="time constant",
         sentence="The measured {label} lags with a time constant of {size}."),
    Kind(kind="vane_position", targets=("alpha", "beta"), unit="m",
         quantity="true minus assumed position of the vane, forward positive",
         sentence="The vane of the {label} stands {size} further forward than it is corrected for."),
    Kind(kind="accelerometer_position", targets=AXES, unit="m", quantity="true minus assumed position, body axes",
         sentence="The accelerometer stands {size} along body {target} from where the aircraft file has it."),
    Kind(kind="cg_offset", targets=AXES, unit="m", quantity="true minus assumed position, body axes",
         sentence="The centre of gravity lies {size} along body {target} from where the aircraft file has it."),
    Kind(kind="mass", targets=(), unit="kg", quantity="true minus assumed mass",
         sentence="The mass differs by {size} from that of the aircraft file."),
    Kind(kind="inertia", targets=("Ixx", "Iyy", "Izz", "Ixz"), unit="kg m2", quantity="true minus assumed inertia",
         sentence="The inertia {target} differs by {size} from that of the aircraft file."),
    Kind(kind="thrust_asymmetry", targets=(), unit="m", quantity="y at which the total thrust acts, right positive",
         sentence="The thrust acts {size} to the right of the plane of symmetry."),
    Kind(kind="thrust_line", targets=(), unit="m", quantity="true minus assumed z of the thrust line, down positive",
         sentence="The thrust line lies {size} lower than the aircraft file has it."),
    Kind(kind="wind_shear", targets=WIND_AXES, unit="m/s2", quantity="rate of change of the wind from the onset on",
         sentence="The wind along {target} changes steadily, by {size}."),
    Kind(kind="gust", targets=WIND_AXES, unit="m/s", quantity="peak of the gust",
         sentence="A gust of {size} along {target} meets the aircraft."),
    Kind(kind="turbulence", targets=WIND_AXES, optional=True, unit="m/s", quantity="r.m.s. velocity",
         sentence="The air is turbulent, with {size} r.m.s.; the model has calm air."),
    Kind(kind="structural_mode", targets=SENSOR_CHANNELS, unit=_UNIT_OF_CHANNEL_PER_SURFACE,
         quantity="gain from the surface that excites it; the frequency stands in the parameters",
         sentence="The {label} carries a lightly damped oscillation, excited with a gain of {size}."),
)  # fmt: skip


def check_effect(kind: str, target: str | None, term: str | None = None, where: str = "") -> None:
    """Raise InputError, with the nearest valid name, unless `kind`, `target` and `term` fit together.

    A kind without target takes None or "". `where` names the place in the message.
    """
    prefix = f"{where}: " if where else ""
    if kind not in KINDS:
        raise unknown("effect kind", kind, KINDS, where)
    entry = KINDS[kind]
    if not target and entry.targets and not entry.optional:
        raise InputError(f"{prefix}effect '{kind}' needs a target; expected one of: {', '.join(entry.targets)}")
    if target and not entry.targets:
        raise InputError(f"{prefix}effect '{kind}' has no target, got '{target}'; leave it out")
    parts = _parts(entry, target)
    for part in parts:
        if part not in entry.targets:
            raise unknown(f"target of '{kind}'", part, entry.targets, where)
    if len(set(parts)) != len(parts):
        raise InputError(f"{prefix}effect '{kind}': target '{target}' names a coefficient twice")
    if entry.needs_term and not term:
        raise InputError(f"{prefix}effect '{kind}' needs a term, like 'alpha^2'")
    if term and not entry.needs_term:
        raise InputError(f"{prefix}effect '{kind}' has no term, got '{term}'; leave it out")
    if term:
        parse_term(term, where)


def effect_unit(kind: str, target: str | None, term: str | None = None) -> str:
    """SI unit of the value of a valid effect, e.g. "s", "1/rad2"; raises InputError when it is not valid."""
    check_effect(kind, target, term)
    unit = KINDS[kind].unit
    if unit == _UNIT_OF_TERM:
        return parse_term(term or "").unit
    return unit.replace(_UNIT_OF_CHANNEL, unit_of(target or ""))


def effect_sentence(kind: str, target: str | None, term: str | None, value: float) -> str:
    """What the effect means, for a person: size to two digits, angles in degrees. Raises InputError when not valid."""
    unit = effect_unit(kind, target, term)
    entry = KINDS[kind]
    label = " and ".join(_LABELS.get(part, label_of(part)) for part in _parts(entry, target))
    percent = f"{_digits(100.0 * value)} %"
    first = (target or "").split("+")[0]
    return entry.sentence.format(label=label, term=term, size=_size(value, unit), percent=percent, target=first)


def _parts(entry: Kind, target: str | None) -> list[str]:
    if not target:
        return []
    return target.split("+") if entry.joined else [target]


def _digits(value: float) -> str:
    return f"{value:.0f}" if abs(value) >= 100.0 else f"{value:.2g}"


def _size(value: float, unit: str) -> str:
    if unit.startswith("rad") and not unit.endswith("/rad"):
        value, unit = math.degrees(value), unit.replace("rad", "deg")
    return _digits(value) if unit == "1" else f"{_digits(value)} {unit}"
