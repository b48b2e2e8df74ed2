"""Blind sets with the aircraft's own file as the model, so that nothing of its structure is missing.

Flights, kinds of effects and answers are those of `problems.blind.sets`; what is hidden in the aerodynamics is drawn
so that it matters beside the derivatives that are free on top of such a file. For "jsbsim" the model is the XML that
JSBSim flew, healthy, as `Aircraft.from_jsbsim` reads it; needs the optional package jsbsim. For "f16" it is NASA's
DAVE-ML.
"""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

from casid.formats.jsbsim.aircraft import INCREMENTS
from casid.model.aircraft import Aircraft
from casid.records.readers import write_record
from problems.blind import f16
from problems.blind.sets import Set, fly_set
from problems.jsbsim.agreement import file_of
from problems.jsbsim.corpus import rounded
from problems.jsbsim.edit import Edit, prepare
from problems.jsbsim.fleet import fleet_airframe

# what the flown file reads from its servos is again what it reads from the control system
_SURFACES = {
    "flight/delta_e-aero": "fcs/elevator-pos-rad",
    "flight/delta_a-aero": "fcs/left-aileron-pos-rad",
    "flight/delta_r-aero": "fcs/rudder-pos-rad",
    "flight/reynolds-number": "aero/Re",
}


def own_file(model: str, folder: Path) -> Path:
    """Write the XML of an aircraft of the fleet, as its flights are flown when nothing is hidden, into `folder`."""
    root = folder / "root"
    prepare(fleet_airframe(model), Edit(), file_of(model).parent.parent.parent, root)
    text = (root / "aircraft" / model / f"{model}.xml").read_text(encoding="utf-8")
    begin, end = text.index("<aerodynamics"), text.index("</aerodynamics>")
    aerodynamics = text[begin:end]
    for servo, property_name in _SURFACES.items():
        aerodynamics = aerodynamics.replace(f">{servo}<", f">{property_name}<")
    path = folder / f"{model}.xml"
    path.write_text(text[:begin] + aerodynamics + text[end:], encoding="utf-8")
    shutil.rmtree(root)
    return path


def own_aircraft(model: str, folder: Path, like: Aircraft) -> Aircraft:
    """The aircraft of its own file, with trim, gravity and instruments as `like` has them."""
    aircraft = Aircraft.from_jsbsim(own_file(model, folder))
    return replace(aircraft, trim=like.trim, gravity=like.gravity, noise=like.noise)


def hide_in_own(of: str, case: str, seed: int, folder: Path) -> Set:
    """Fly a set of "jsbsim" or "f16", and write its records and aircraft.toml into `folder`, with an XML beside it."""
    flown = fly_set(of, case, seed, structure=INCREMENTS)
    folder.mkdir(parents=True, exist_ok=True)
    for record in flown.records:
        write_record(rounded(record), folder / f"{record.name}.csv")
    if of == "f16":
        aircraft = f16.plane().aircraft
    else:
        aircraft = own_aircraft(flown.aircraft.name.removesuffix(", cruise"), folder, flown.aircraft)
    aircraft.write(folder / "aircraft.toml")
    return replace(flown, aircraft=aircraft)
