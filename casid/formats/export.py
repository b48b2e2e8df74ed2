"""An aircraft file in the files of other simulators."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType

from scipy.io import savemat

from casid.arguments import a_path, one_of
from casid.errors import InputError
from casid.formats.ardupilot import ardupilot_text
from casid.formats.gazebo import gazebo_text
from casid.formats.jsbsim.write import jsbsim_text
from casid.formats.matlab import mat_of, matlab_text, struct_of
from casid.formats.multirotor import MULTIROTOR, rotorpy_text, table_text
from casid.formats.tables import csv_text, latex_text
from casid.keeping import whole_file
from casid.model.aircraft import Aircraft, given_aircraft

Made = tuple[str, tuple[str, ...]]
# target -> endings of its file, and what makes its text and lists what it does not hold
TARGETS: Mapping[str, tuple[tuple[str, ...], Callable[[Aircraft], Made]]] = MappingProxyType(
    {
        "ardupilot-json": ((".json",), ardupilot_text),
        "gazebo": ((".sdf",), gazebo_text),
        "matlab": ((".m", ".mat"), lambda a: (matlab_text(struct_of(a)), ())),
        "csv": ((".csv",), lambda a: (csv_text(a), ())),
        "latex": ((".tex",), lambda a: (latex_text(a), ())),
        "jsbsim": ((".xml",), jsbsim_text),
        "rotorpy": ((".py",), rotorpy_text),
        "gym-json": ((".json",), table_text),
    }
)


def export(aircraft: Aircraft | str | Path, path: str | Path, *, to: str) -> tuple[str, ...]:
    """Write an aircraft as a file of another simulator.

    Parameters
    ----------
    aircraft
        The aircraft, or the name of its file, such as the extended one of a diagnosis.
    path
        The file to write: .json, .sdf, .m or .mat, .csv, .tex, .xml, .py. Its folder is made.
    to
        "ardupilot-json", "gazebo", "matlab", "csv", "latex" or "jsbsim"; of a multirotor the first two, "rotorpy" or
        "gym-json".

    Returns
    -------
    tuple of str
        What the file does not hold, a line each; these lines are also comments of it, where it can have them.

    Raises
    ------
    InputError
        For an unknown target, another ending, and an aircraft that the target cannot hold at all.

    Examples
    --------
    >>> import casid as cs, tempfile, pathlib
    >>> folder = pathlib.Path(tempfile.mkdtemp())
    >>> left = cs.export("casid/cli/demo/aircraft.toml", folder / "plane.json", to="ardupilot-json")
    >>> any("gyroscopic" in line for line in left)
    True
    """
    file = given_aircraft(aircraft, "export")
    endings, make = TARGETS[one_of(to, TARGETS, "export: to")]
    target = a_path(path, "export")
    if target.suffix.lower() not in endings:
        raise InputError(f"{target}: {to} is written as {' or '.join(endings)}; name the file so")
    if target.suffix.lower() == ".mat":
        struct = mat_of(struct_of(file))
        with whole_file(target) as temporary:
            target.parent.mkdir(parents=True, exist_ok=True)
            savemat(temporary, {"aircraft": struct}, appendmat=False, long_field_names=True, oned_as="row")
        return ()
    if file.rotors is not None and not file.winged:
        make = MULTIROTOR.get(to, make)
    text, left = make(file)
    with whole_file(target) as temporary:
        target.parent.mkdir(parents=True, exist_ok=True)
        temporary.write_text(text, encoding="utf-8", newline="\n")
    return left
