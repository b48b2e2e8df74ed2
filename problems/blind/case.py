"""What a blind test hides, in the words of the vocabulary, and how it is kept in a sealed answer."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

from casid.model.terms import COEFFICIENTS
from casid.model.vocabulary import KINDS, effect_unit

RECORDS: tuple[str, ...] = ("m1", "m2", "m3", "m4")  # the last is what `casid diagnose` holds back
# effects that no entry of the vocabulary describes; a diagnosis must not name anything for them
OUTSIDE: Mapping[str, str] = MappingProxyType(
    {
        "rotor_gyroscope": "gyroscopic moment of a spinning rotor, which couples pitch and yaw",
        "propeller_hum": "moment that hums at one frequency, its strength coming and going",
        "sensor_drift": "instrument whose zero wanders slowly",
        "fuel_slosh": "lightly damped mass of fuel that swings sideways under the lateral acceleration",
        "stall_break": "wing that drops when the flow separates above an angle of attack, until below a lower one",
        "wing_bending": "wing that bends, and so loses incidence, as a lightly damped mode",
        "slow_change": "surface whose effectiveness fades and comes back during a record",
        "flapping": "rotor blades that flap, and so turn the hub with the motion",
        "translational_lift": "rotors whose thrust grows with the square of the speed across them",
        "quadratic_drag": "body drag that grows with the square of the speed",
        "product_of_inertia": "inertia that couples roll and pitch, in a file without",
    }
)
# kinds of which `problems.faults` has the generator, put into records of any flight; what needs a table in the file;
# what only `problems.independent` or `problems.strips` have
NOT_DRAWN = ("sensor_misalignment", "position_error", "clock_drift", "thrust_scale", "table_increment")
NOT_DRAWN += ("wing_bending", "slow_change", "feedback", "stuck", "moment_reference")
# what a diagnosis of an aircraft does not look for by itself
STATED = ("second_order_actuator", "input_limit", "input_offset", "input_scale", "sample_hold", "sensor_stuck")
STATED += ("hysteresis", "sensor_resolution")
STATED += ("missing_derivative", "rotor_rise_fall", "rotor_limit", "rotor_tilt")
OF_EQUATIONS = ("missing_term", "damping", "cross_damping", "dry_friction", "relaxation", "inertia_scale")
OF_EQUATIONS += ("parameter_change", "parameter_split", "common_factor")
ROTORS = ("rotor_effectiveness", "rotor_torque", "rotor_lag", "rotor_delay", "rotor_position", "rotor_swap")
ROTORS += ("thrust_curve", "rotor_inflow", "added_mass", "mass_change", "body_drag", "battery_sag")
NOT_DRAWN += (*ROTORS, *STATED, *OF_EQUATIONS, "flapping", "translational_lift", "quadratic_drag", "product_of_inertia")
# the last are none of an aeroplane; `problems.rotors` has their generator
LOADING = ("mass", "inertia", "cg_offset")  # of which free derivatives show differences between records only
FAMILIES: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "controls": (
            "actuator_lag",
            "input_delay",
            "rate_limit",
            "dead_zone",
            "backlash",
            "effectiveness_change",
            "feedback",
            "stuck",
        ),
        "sensors": (
            "sensor_bias",
            "sensor_scale",
            "sensor_delay",
            "sensor_lag",
            "vane_position",
            "accelerometer_position",
            "structural_mode",
            "sensor_misalignment",
            "position_error",
            "clock_drift",
        ),
        "aerodynamics": ("aero_term", "unsteady_aero", "configuration_change", "table_increment"),
        "mass and propulsion": (
            "cg_offset",
            "moment_reference",
            "mass",
            "inertia",
            "thrust_asymmetry",
            "thrust_line",
            "thrust_scale",
        ),
        "air": ("wind_shear", "gust", "turbulence"),
        "rotors": ROTORS,
        "stated": STATED,
        "equations of any model": OF_EQUATIONS,
    }
)


def family(kind: str, target: str = "") -> str:
    """The family of a kind; the effectiveness of thrust is propulsion's."""
    if (kind, target) == ("effectiveness_change", "thrust"):
        return "mass and propulsion"
    return next(name for name, kinds in FAMILIES.items() if kind in kinds)


@dataclass(frozen=True, kw_only=True)
class Hidden:
    """One hidden effect; kind, target, term, sign and unit as in the vocabulary, or a kind of OUTSIDE.

    records     that have it
    onset_s     record -> start [s], of an event
    parameters  what belongs to it besides (length of a gust, steps of further coefficients, a frequency)
    """

    kind: str
    target: str = ""
    term: str | None = None
    value: float
    records: tuple[str, ...] = RECORDS
    onset_s: Mapping[str, float] | None = None
    parameters: Mapping[str, float] = field(default_factory=dict)

    @property
    def unit(self) -> str:
        """SI unit of `value`; an effect outside the catalogue is a share, or of its channel."""
        return effect_unit(self.kind, self.target, self.term) if self.kind in KINDS else "(of the effect)"

    @property
    def imitated(self) -> bool:
        """Whether free derivatives imitate it: the mass, an inertia or the c.g. of all records."""
        return self.kind in LOADING and set(self.records) == set(RECORDS)

    def scaled(self, factor: float) -> Hidden:
        """The same effect, `factor` times as large; a rate limit is the larger the slower it is."""
        steps = {name: factor * x if name in COEFFICIENTS else x for name, x in self.parameters.items()}
        value = self.value / factor if self.kind == "rate_limit" else self.value * factor
        return replace(self, value=value, parameters=steps)


@dataclass(frozen=True, kw_only=True)
class Answer:
    """The sealed answer of a set.

    of          one of SETS;  case, seed  what it was drawn from;  aircraft  what flew
    size        factor on the drawn size; 1: what an engineer would notice
    hidden      empty: clean
    mismatch    coefficient -> what the terms of the aircraft file, at their best, leave of it without anything hidden:
                r.m.s. as a part of the coefficient's variation
    conditions  rate [Hz], noise level and such
    values      derivatives and terms of the aircraft that flew, named as in the aircraft file
    besides     what is true in the set and was not hidden: weather, terms that the file of an aircraft lacks
    """

    of: str
    case: str
    seed: int
    size: float
    aircraft: str
    hidden: tuple[Hidden, ...]
    mismatch: Mapping[str, float]
    conditions: Mapping[str, Any]
    values: Mapping[str, float] = field(default_factory=dict)
    besides: tuple[Hidden, ...] = ()

    def write(self, path: Path) -> None:
        told = {
            name: [{**asdict(one), "unit": one.unit} for one in effects]
            for name, effects in (("hidden", self.hidden), ("besides", self.besides))
        }
        path.write_text(json.dumps({**asdict(self), **told}, indent=1) + "\n", encoding="utf-8")

    @classmethod
    def read(cls, path: Path) -> Answer:
        table = json.loads(path.read_text(encoding="utf-8"))
        return cls(**table | {name: tuple(map(_hidden, table[name])) for name in ("hidden", "besides")})


def _hidden(table: Mapping[str, Any]) -> Hidden:
    return Hidden(
        kind=table["kind"],
        target=table["target"],
        term=table["term"],
        value=table["value"],
        records=tuple(table["records"]),
        onset_s=table["onset_s"],
        parameters=table["parameters"],
    )
