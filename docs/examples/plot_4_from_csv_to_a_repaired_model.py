"""
Tutorial: from CSV files to a repaired model
============================================

Four manoeuvres of a Fokker 50 were recorded, and its simulation does not match them. What does the simulation lack?
This page reads the records in the units of a flight-test department, names the cause, writes the repaired aircraft
file, and flies a qualification test with it. The notebook of the page is at its foot.

The aircraft was flown by JSBSim. Its elevator follows the command with a lag of 0.12 s, which the aircraft file does
not contain. Install casid with ``pip install .`` first; ``casid demo`` makes the same diagnosis on the command line.
"""

import tempfile
from importlib.resources import files
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import casid as cs

# sphinx_gallery_thumbnail_number = 2

# %%
# Records in kt, deg, g and ft
# ----------------------------
# A record is a CSV file for each manoeuvre. Units stand in its header. Here they are made from the embedded example.
demo = files("casid.cli").joinpath("demo")
folder = Path(tempfile.mkdtemp())
UNITS = {"kt": 1852.0 / 3600.0, "deg": np.pi / 180.0, "deg/s": np.pi / 180.0, "deg/s2": np.pi / 180.0, "ft": 0.3048}
UNITS |= {"g": 9.80665, "lbf": 4.4482216, "s": 1.0, "kg/m3": 1.0}
CHANNELS = dict.fromkeys(("alpha", "beta", "phi", "theta", "psi", "delta_e", "delta_a", "delta_r"), "deg")
CHANNELS |= dict.fromkeys(("p", "q", "r"), "deg/s") | dict.fromkeys(("pdot", "qdot", "rdot"), "deg/s2")
CHANNELS |= dict.fromkeys(("ax", "ay", "az"), "g")
CHANNELS |= {"t": "s", "V": "kt", "altitude": "ft", "thrust": "lbf", "rho": "kg/m3"}
for number in (1, 2, 3, 4):
    names = demo.joinpath(f"m{number}.csv").read_text().split("\n", 1)[0].split(",")
    values = np.genfromtxt(str(demo.joinpath(f"m{number}.csv")), delimiter=",", skip_header=1)
    header = ",".join(f"{name} [{CHANNELS[name]}]" for name in names)
    scale = np.array([UNITS[CHANNELS[name]] for name in names])
    np.savetxt(folder / f"m{number}.csv", values / scale, delimiter=",", header=header, comments="", fmt="%.8g")
print("\n".join((folder / "m1.csv").read_text().split("\n")[:3]))

# %%
# Inside casid, all numbers are in SI units and radians.
records = cs.read_records(str(folder / "m*.csv"))
print(records[0])
print(f"V {records[0]['V'][0]:.1f} m/s, az {records[0]['az'][0]:.2f} m/s2, altitude {records[0]['altitude'][0]:.0f} m")

# %%
# The aircraft file has mass properties, reference lengths and derivatives.
aircraft = cs.Aircraft.read(str(demo / "aircraft.toml"))
print({name: aircraft.derivatives[name] for name in ("CL_alpha", "Cm_alpha", "Cm_q", "Cm_delta_e")})

# %%
# Check the data
# --------------
# A wrong sign or unit would be mistaken for aerodynamics. The check compares channels with each other and with the
# file.
print(cs.check(records, aircraft))

# %%
# Diagnose
# --------
# Three records are used for the search. The fourth is held out: it only measures the improvement.
diagnosis = cs.diagnose(aircraft, records[:3], hold_out=records[3:])
print(diagnosis)

# %%
# The error of each channel on the held-out record after each step: data corrected, values re-estimated, cause added.
diagnosis.budget.plot()
plt.show()

# %%
# The repaired model
# ------------------
# The extended aircraft has the re-estimated values and the named causes. It is an aircraft file like any other.
diagnosis.extended_aircraft.write(folder / "extended.toml")
for effect in diagnosis.extended_aircraft.effects:
    print(effect.kind, effect.target, effect.value, "+-", effect.std)

# %%
# Proof of match
# --------------
# The held-out record by the tolerances of 14 CFR Part 60, appendix A, table A2A: with the file as given, and with the
# extended file. Below a test: what leaves the tolerance when one part of the extended file is taken out.
proof = cs.proof_of_match(aircraft, records[3], extended=cs.Aircraft.read(folder / "extended.toml"))
print(proof)

# %%
# The short period. Grey: the tolerance about flight. The bars at the foot show when a simulation is out of tolerance.
proof.plot("2.c.10")
plt.show()

# %%
# Where to go from here
# ---------------------
# ``casid convert IN OUT`` reads foreign formats, and ``casid new-aircraft plane.toml`` asks for the minimum that an
# aircraft file needs. On your flight, the same is done by
#
# .. code-block:: text
#
#    casid check m*.csv --aircraft plane.toml
#    casid diagnose m1.csv m2.csv m3.csv --hold-out m4.csv --aircraft plane.toml --out out/plane
#    casid match m4.csv --aircraft plane.toml out/plane/extended.toml
#
# :doc:`Your own data </your-data>` describes records, and :doc:`The aircraft file </aircraft-file>` the file.
# :doc:`Reading a verdict </reading-a-verdict>` explains each line of the result, and
# :doc:`How a diagnosis decides </diagnosis>` follows this example through every step. If two causes cannot be
# separated, ``next_flight.csv`` contains the manoeuvre that would separate them.
