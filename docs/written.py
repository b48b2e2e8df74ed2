"""Pages written from definitions: one for every cause of the catalogue, one for every number that decides."""

from __future__ import annotations

import csv
import re
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from equations import EQUATIONS

from casid.criterion import listed
from casid.diagnosis.criteria import Criteria
from casid.model import causes  # noqa: F401  fills the register
from casid.model.effect import KINDS, Kind
from casid.model.vocabulary import effect_unit
from problems.blind.case import FAMILIES, Hidden
from problems.blind.do328 import plane

CRITERIA = Path(__file__).resolve().parent / "criteria.md"  # `python docs/written.py` writes these two anew
CAUSES = CRITERIA.with_name("causes.md")
RESULTS = Path(__file__).resolve().parent.parent / "problems" / "blind" / "results.csv"
DEG = np.pi / 180.0
# An example of each kind on the Do 328: target, value, term, further parameters, onset [s]
EXAMPLES: dict[str, dict[str, Any]] = {
    "actuator_lag": {"target": "delta_e", "value": 0.15},
    "input_delay": {"target": "delta_e", "value": 0.08},
    "rate_limit": {"target": "delta_a", "value": 0.08},
    "dead_zone": {"target": "delta_e", "value": 0.006},
    "backlash": {"target": "delta_r", "value": 0.01},
    "effectiveness_change": {"target": "delta_a", "value": -0.5, "onset": 8.0},
    "stuck": {"target": "delta_a", "value": 1.0, "onset": 8.0, "duration": 5.0},
    "feedback": {"target": "delta_r", "term": "r", "value": 0.3, "time_constant": 3.0},
    "sensor_bias": {"target": "q", "value": 0.4 * DEG},
    "sensor_scale": {"target": "alpha", "value": 0.1},
    "sensor_delay": {"target": "beta", "value": 0.1},
    "sensor_lag": {"target": "alpha", "value": 0.15},
    "vane_position": {"target": "alpha", "value": 5.0},
    "accelerometer_position": {"target": "x", "value": 2.0},
    "cg_offset": {"target": "x", "value": 0.2},
    "mass": {"target": "", "value": 1000.0},
    "inertia": {"target": "Ixz", "value": 8000.0},
    "moment_reference": {"target": "x", "value": 0.2},
    "thrust_line": {"target": "", "value": 0.3},
    "thrust_asymmetry": {"target": "", "value": 0.1},
    "aero_term": {"target": "Cm", "value": 2.0, "term": "alpha^2"},
    "unsteady_aero": {"target": "Cm", "value": -6.0},
    "wind_shear": {"target": "x", "value": 0.6, "onset": 8.0},
    "gust": {"target": "z", "value": 4.0, "onset": 8.0, "parameters": {"length": 1.5}},
    "configuration_change": {"target": "CL+CD", "value": 0.1, "onset": 8.0, "parameters": {"CD": 0.02}},
    "turbulence": {"target": "", "value": 0.8},
    "structural_mode": {"target": "q", "value": 0.3, "parameters": {"frequency_hz": 4.0, "damping": 0.03}},
    "sensor_misalignment": {"target": "inertial", "value": 3.0 * DEG, "term": "x"},
    "position_error": {"target": "V", "value": 40.0, "term": "alpha"},
    "thrust_scale": {"target": "", "value": 0.15},
    "clock_drift": {"target": "inertial", "value": 0.01},
}
SHOWN = {"V": ("m/s", 1.0), "alpha": ("deg", 1 / DEG), "q": ("deg/s", 1 / DEG), "az": ("m/s²", 1.0)} | {
    "beta": ("deg", 1 / DEG),
    "p": ("deg/s", 1 / DEG),
    "r": ("deg/s", 1 / DEG),
    "ay": ("m/s²", 1.0),
}


def write(folder: Path) -> None:
    """Write all pages below `folder`; pictures that are there already are kept."""
    (folder / "causes").mkdir(parents=True, exist_ok=True)
    blind = list(csv.DictReader(RESULTS.open(encoding="utf-8")))
    for kind in KINDS.values():
        picture = _picture(kind.kind, folder / "causes")
        (folder / "causes" / f"{kind.kind}.md").write_text(_cause_page(kind, picture, blind), encoding="utf-8")
    names = "\n".join(sorted(KINDS))
    (folder / "causes" / "index.md").write_text(
        "# The causes, with their effects\n\nThe effect of each [cause](../../causes.md) on one flight.\n\n"
        f"```{{toctree}}\n:maxdepth: 1\n\n{names}\n```\n",
        encoding="utf-8",
    )
    write_kept()


def write_kept() -> None:
    """Write the two pages that are in the repository, where readers of a clone find them."""
    CRITERIA.write_text(criteria_page(), encoding="utf-8")
    CAUSES.write_text(causes_page(), encoding="utf-8")


def causes_page() -> str:
    """Write the definitions of all causes, by the family that they belong to."""
    lines = [_CAUSES_HEAD]
    for name, kinds in FAMILIES.items():
        lines += [f"## {name.capitalize()}", ""]
        for kind in (KINDS[k] for k in kinds):
            lines += [f"### `{kind.kind}`", "", *_definition(kind), ""]
    return "\n".join(lines).rstrip() + "\n"


_CAUSES_HEAD = """# Every cause that can be named

A cause is a way in which the aircraft, its instruments or the air may differ from the aircraft file. This page has the
definition of each: its sentence in a report, its value, where it may act, and its equation, in which $v$ is the value.
Times are in seconds, angles in radians. Body axes point forward (x), right (y) and down (z).

The documentation that `make docs` builds has a page for each, with its effect on a flight and how often it was found.

## Signs of the control surfaces

casid has no convention of its own: a surface is positive where the derivatives of your file say so.

| surface | usual sign | your file has that sign when | positive deflection then gives |
|---|---|---|---|
| elevator `delta_e` | trailing edge down | `Cm_delta_e` < 0 | nose down |
| aileron `delta_a` | right aileron up, left aileron down | `Cl_delta_a` > 0 | right wing down |
| rudder `delta_r` | trailing edge left | `Cn_delta_r` < 0 | nose left |

With the opposite sign in the file, positive is the opposite deflection; for ailerons both signs are common. The records
must have the signs of the file: `casid check` reports a surface to which the aircraft answers in the opposite sense.
"""


def _definition(kind: Kind) -> list[str]:
    """The lines that define a cause: sentence, value, targets, equation."""
    targets = ", ".join(f"`{t}`" for t in kind.targets) if kind.targets else "a rotor" if kind.of_rotors else "none"
    sentence = re.sub(r"\[(\w+)\|(\w+)\]", r"\1 (or \2)", kind.sentence).replace("{", "*").replace("}", "*")
    formula, symbols = EQUATIONS[kind.kind]
    return [
        f"> {sentence}",
        "",
        f"- Value [{_unit(kind.unit)}]: {kind.quantity}.",
        f"- Targets: {targets}{', joined with +' if kind.joined else ''}.",
        "",
        "$$",
        formula,
        "$$",
        *(["", symbols] if symbols else []),
    ]


def _cause_page(kind: Kind, picture: str | None, blind: list[dict[str, str]]) -> str:
    lines = [f"# `{kind.kind}`", "", *_definition(kind), "", "Here $v$ is the value."]
    if picture:
        lines += ["", "## Its fingerprint on the Do 328", "", f"![{kind.kind}]({picture})", ""]
        lines += ["What the instruments read with it, less what they read without it, in the same flight: doublets of"]
        lines += ["elevator (1 s), aileron (5 s), rudder (9 s) and throttle (13 s). " + _example(kind.kind)]
    lines += ["", "## In blind tests", "", *_rates(kind.kind, blind)]
    return "\n".join(lines) + "\n"


def _unit(unit: str) -> str:
    words = {"{channel}": "the unit of the channel", "{term}": "the unit of the term", "{gain}": "s or 1"}
    for field, said in words.items():
        unit = unit.replace(field, said)
    return unit or "1"


def _rates(kind: str, blind: list[dict[str, str]]) -> list[str]:
    """How often it was found first when it was hidden alone, what was named instead, and the smallest size found."""
    own = [row for row in blind if row["case"] == kind and row["size"] == "1.0"]
    if not own:
        return ["No campaign has hidden this kind yet."]
    right = [row for row in own if row["first"] == "True"]
    instead = Counter(name for row in own if row["first"] != "True" for name in _kinds(row["causes"]))
    lines = [f"Hidden alone in {len(own)} flights of JSBSim, the Do 328 and the F-16: named first in {len(right)}."]
    if instead:
        lines += ["", "Named instead: " + ", ".join(f"`{k}` ({n})" for k, n in instead.most_common(4)) + "."]
    missed = sum(not row["causes"] for row in own)
    if missed:
        lines += ["", f"Nothing was named in {missed}."]
    sizes: dict[str, list[float]] = {}
    for row in right:
        found = re.match(rf"{kind}\(([^)]*)\) (-?[\d.e+-]+)", row["hidden"])
        if found:
            sizes.setdefault(found[1], []).append(abs(float(found[2])))
    if sizes:
        lines += ["", "| target | smallest size found |", "|---|---|"]
        lines += [f"| `{t or '-'}` | {_sized(min(values), kind, t)} |" for t, values in sorted(sizes.items())]
    return lines


def _sized(value: float, kind: str, target: str) -> str:
    """With its unit; `target` as in tables, "Cm:alpha^2"."""
    channel, _, term = target.partition(":")
    unit = effect_unit(kind, channel, term or None)
    return f"{value:.3g}" if unit == "1" else f"{value:.3g} {unit}"


def _kinds(named: str) -> Iterator[str]:
    yield from (name.split("(")[0].strip() for name in named.split(";") if name.strip())


def _picture(kind: str, folder: Path) -> str | None:
    """What the cause does to the readings of one flight."""
    if kind not in EXAMPLES:
        return None
    file = folder / f"{kind}.svg"
    if not file.exists():
        example = EXAMPLES[kind]
        t = np.arange(0.0, 16.0, 0.005)
        moves = {name: size * _doublet(t, at) for name, (size, at) in _MOVES.items()}
        hidden = Hidden(
            kind=kind,
            target=example["target"],
            value=example["value"],
            term=example.get("term"),
            records=("m1",),
            onset_s={"m1": example["onset"]} if "onset" in example else {},
            parameters=example.get("parameters", {}),
        )
        without, with_it = plane().fly("m1", t, moves), plane().fly("m1", t, moves, [hidden])
        _draw(t, {name: with_it[name] - without[name] for name in SHOWN}, file)
    return file.name


_MOVES = {"delta_e": (0.03, 1.0), "delta_a": (0.05, 5.0), "delta_r": (0.05, 9.0), "throttle": (0.25, 13.0)}


def _doublet(t: np.ndarray, at: float) -> np.ndarray:
    return np.where((t >= at) & (t < at + 1.0), 1.0, np.where((t >= at + 1.0) & (t < at + 2.0), -1.0, 0.0))


def _example(kind: str) -> str:
    example = EXAMPLES[kind]
    target = ", ".join(str(example[k]) for k in ("target", "term") if example.get(k))
    size = _sized(example["value"], kind, ":".join(str(example[k]) for k in ("target", "term") if example.get(k)))
    return f"Drawn for a value of {size}" + (f" of `{target}`." if target else ".")


def _draw(t: np.ndarray, change: dict[str, np.ndarray], file: Path) -> None:
    figure, axes = plt.subplots(4, 2, figsize=(8.0, 5.2), sharex=True, layout="constrained")
    for axis, (name, (unit, factor)) in zip(axes.T.flat, SHOWN.items(), strict=True):
        values = factor * change[name]
        axis.plot(t, values, color="#0b5fa5", linewidth=1.2)
        axis.axhline(0.0, color="0.7", linewidth=0.6)
        axis.set_ylabel(f"{name} [{unit}]")
        room = max(float(np.abs(values).max()), 1e-3)
        axis.set_ylim(-1.15 * room, 1.15 * room)
    for axis in axes[-1]:
        axis.set_xlabel("time [s]")
    figure.savefig(file)
    plt.close(figure)


def criteria_page() -> str:
    """Write the table of all criteria."""
    return "\n".join(_criteria_lines()) + "\n"


def _criteria_lines() -> Iterator[str]:
    yield "# Every number that decides"
    yield ""
    yield "Vary one with `casid diagnose --criteria my.toml`, or `cs.diagnose(..., criteria=...)`."
    yield ""
    yield "| name | value | unit | meaning | evidence |"
    yield "|---|---|---|---|---|"
    for one in listed(Criteria()):
        cells = (f"`{one.name}`", one.value, one.unit or "1", one.meaning, one.evidence)
        yield "| " + " | ".join(str(cell).replace("|", "/").replace("\n", " ") for cell in cells) + " |"


if __name__ == "__main__":
    write_kept()
