"""
A diagnosis: what the aircraft file lacks
=========================================

The embedded example: a Fokker 50 flown by JSBSim. Its elevator lags its command, of which the file knows nothing.
"""

from importlib.resources import files

import matplotlib.pyplot as plt

import casid as cs

folder = files("casid.cli").joinpath("demo")
aircraft = cs.Aircraft.read(str(folder / "aircraft.toml"))
records = cs.read_records([str(folder / f"m{i}.csv") for i in (1, 2, 3, 4)])

# %%
# Three records are fitted, the fourth is only used to judge.
diagnosis = cs.diagnose(aircraft, records[:3], hold_out=records[3:])
print(diagnosis)

# %%
# What each step takes off the error on the fourth record: mended data, values refitted, the cause put in.
diagnosis.budget.plot()
plt.show()

# %%
# What the extended file says in addition.
for effect in diagnosis.extended_aircraft.effects:
    print(effect.kind, effect.target, effect.value, "+-", effect.std)
