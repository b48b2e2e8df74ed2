"""
A real aircraft: HFB-320
========================

An elevator 3-2-1-1 and a pulse, flown in turbulence (R. V. Jategaonkar, *Flight Vehicle System Identification*). Output
error takes the air as calm, filter error does not: the estimates differ where turbulence looks like aerodynamics.

The record is not part of casid. It is in the supplement 10.2514/4.102790 of AIAA; `CASID_DATA` names its folder.
Without it the gallery leaves this example out.
"""

import os
from dataclasses import replace
from pathlib import Path

import matplotlib.pyplot as plt

import casid as cs
from problems.real import hfb320

file = Path(os.environ["CASID_DATA"]) / "hfb320_1_10.asc"

# %%
# Eleven derivatives and four biases, the noise and the initial state.
record = hfb320.record_from(file)
problem = hfb320.problem(record)
calm = cs.solve(problem)
print(calm)

# %%
# The same with moving air: white process noise (a correlation time of 0 s), whose strength is estimated too.
turbulent = cs.solve(replace(problem, cost=cs.FilterError(process_noise={"w_V": 0.0, "w_alpha": 0.0})))
print(f"{'':12} {'published':>10} {'output':>10} {'filter':>10} {'1-sigma':>9}")
for name, value in hfb320.PUBLISHED.items():
    mine = calm[name].value, turbulent.values[name], turbulent[name].std
    print(f"{name:12} {value:10.4g} {mine[0]:10.4g} {mine[1]:10.4g} {mine[2]:9.2g}")

# %%
# What output error leaves of the measurements.
calm.plot()
plt.show()
