"""How large derivatives are: over the aircraft that come with JSBSim, each at the speed of a lift coefficient of 0.4.

This is where the numbers of `casid.model.usual_derivatives` come from.

    python -m problems.jsbsim.derivative_sizes
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import replace

import numpy as np

from casid.cli.start import run_script
from casid.errors import InputError
from casid.model.aircraft import Aircraft
from casid.model.linearised import given_slopes
from problems.jsbsim.agreement import file_of

LONGITUDINAL, LATERAL = ("0", "alpha", "q", "delta_e"), ("beta", "p", "r", "delta_a", "delta_r")
TERMS: Mapping[str, tuple[str, ...]] = {
    **dict.fromkeys(("CL", "CD", "Cm"), LONGITUDINAL),
    **dict.fromkeys(("CY", "Cl", "Cn"), LATERAL),
}
HOLDS = 1.96  # 1-sigmas: the size that 95 % of the aircraft do not exceed
_LIFT, _ALPHA, _RHO, _FASTEST, _GRAVITY = 0.4, 0.07, 1.0, 280.0, 9.81
_THRUST = 0.15  # of the weight


def sizes(aircraft: Iterable[Aircraft]) -> dict[str, float]:
    """Derivative -> 1-sigma about zero of which 95 % of the aircraft that have it are within 1.96.

    Of body axes by the same slopes, turned by the angle of attack. Rates are p b/2V, q c/2V, r b/2V.
    """
    found: dict[str, list[float]] = {}
    for one in aircraft:
        slopes = _slopes(one)
        for name, value in {**slopes, **_turned(slopes)}.items():
            if value != 0.0:
                found.setdefault(name, []).append(abs(value))
    return {name: float(np.percentile(values, 95.0)) / HOLDS for name, values in sorted(found.items())}


def _slopes(one: Aircraft) -> dict[str, float]:
    weight = one.mass * _GRAVITY
    V = min(math.sqrt(2.0 * weight / (_RHO * one.area * _LIFT)), _FASTEST)
    names = {f"{coefficient}_{term}": 0.0 for coefficient, terms in TERMS.items() for term in terms}
    trim = {"V": V, "rho": _RHO, "alpha": _ALPHA, "thrust": _THRUST * weight}
    return given_slopes(replace(one, derivatives=names, trim=trim))


def _turned(wind: Mapping[str, float]) -> dict[str, float]:
    """Slopes of CX and CZ at the angle of attack at which those of lift and drag were taken."""
    c, s = math.cos(_ALPHA), math.sin(_ALPHA)
    body = {}
    for term in LONGITUDINAL:
        lift, drag = wind.get(f"CL_{term}", 0.0), wind.get(f"CD_{term}", 0.0)
        body |= {f"CX_{term}": lift * s - drag * c, f"CZ_{term}": -lift * c - drag * s}
    CL = wind.get("CL_0", 0.0) + _ALPHA * wind.get("CL_alpha", 0.0)
    CD = wind.get("CD_0", 0.0) + _ALPHA * wind.get("CD_alpha", 0.0)
    turning = {"CX": CL * c + CD * s, "CZ": CL * s - CD * c}
    for coefficient, by_turning in turning.items():
        body[f"{coefficient}_alpha"] += by_turning
    level = {"CX": CL * s - CD * c, "CZ": -CL * c - CD * s}
    return body | {f"{name}_0": level[name] - _ALPHA * body[f"{name}_alpha"] for name in level}


def fleet() -> list[Aircraft]:
    """The stock aircraft whose functions can be read. Needs jsbsim."""
    read = []
    for folder in sorted(file_of("any").parent.parent.iterdir()):
        try:
            read.append(Aircraft.from_jsbsim(folder / f"{folder.name}.xml"))
        except InputError:  # listed with its reason in aircraft.md
            continue
    return read


def main() -> None:
    for name, size in sizes(fleet()).items():
        print(f"{name:12} {size:.2g}")


if __name__ == "__main__":
    run_script(main)
