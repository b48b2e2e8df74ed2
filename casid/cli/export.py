"""`casid export`: an aircraft file in the files of other simulators."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from casid.cli.options import AsJson, aircraft_of
from casid.formats.export import TARGETS
from casid.formats.export import export as written


def export(
    aircraft: Annotated[Path, Parameter(name="AIRCRAFT")],
    *,
    to: Literal["ardupilot-json", "gazebo", "matlab", "csv", "latex", "jsbsim", "rotorpy", "gym-json"],
    out: Annotated[Path | None, Parameter(name="--out")] = None,
    as_json: AsJson = False,
) -> None:
    """Write an aircraft file as a file of another simulator.

    Parts that the other simulator cannot represent are written as comments and reported, or the export is refused.

    Parameters
    ----------
    aircraft
        The aircraft file (TOML), such as the extended.toml of a diagnosis.
    to
        SITL of ArduPilot, Gazebo's AdvancedLiftDrag, a struct of MATLAB and Simulink, tables, or JSBSim. Of a
        multirotor a frame of SITL, Gazebo's motor model, RotorPy, or a table for learning environments.
    out
        The file; default: named like the aircraft file, in the current folder. A struct is written as .m or as
        .mat, by the ending.
    as_json
        Print the file's name and what it does not hold as JSON and nothing else.
    """
    target = out or Path(aircraft.stem + TARGETS[to][0][0])
    left = written(aircraft_of(aircraft), target, to=to)
    if as_json:
        print(json.dumps({"file": str(target), "left_out": list(left)}, indent=1))
        return
    for line in left:
        print(f"not held: {line}", file=sys.stderr)
    print(target)
