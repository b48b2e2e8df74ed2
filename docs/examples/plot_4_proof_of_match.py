"""
Proof of match: a test of Part 60 before and after a lag is known
=================================================================

The embedded Fokker 50 is flown against its fourth record by the tolerances of 14 CFR Part 60, appendix A, table A2A: as
its file gives it, and extended by what a diagnosis of the other three records found, among it the lag of the elevator.
"""

from importlib.resources import files

import matplotlib.pyplot as plt

import casid as cs

folder = files("casid.cli").joinpath("demo")
aircraft = cs.Aircraft.read(str(folder / "aircraft.toml"))
records = cs.read_records([str(folder / f"m{i}.csv") for i in (1, 2, 3, 4)])
diagnosis = cs.diagnose(aircraft, records[:3], hold_out=records[3:])

# %%
# Every test whose manoeuvre the record shows. Below a test: what leaves the tolerance when one part of the extended
# file is taken out.
proof = cs.proof_of_match(aircraft, records[3], extended=diagnosis.extended_aircraft)
print(proof)

# %%
# The short period. Grey: the tolerance about flight. The bars at the foot show when a simulation is out of it.
proof.plot("2.c.10")
plt.show()

# %%
# How much of each tolerance is used without the lag, all else as extended.
for cost in proof.tests[0].costs:
    if cost.lost:
        print(cost.part, {name: f"{100 * used:.0f} %" for name, used in cost.used.items()})
