"""
Estimate what a diagnosis found
===============================

A diagnosis names a lag of the elevator. Whatever it names is a part of the extended aircraft, and its sizes are
parameters of the model like the derivatives: a problem of one's own estimates them again, bounds them, and solves them
by single or multiple shooting, by Gauss-Newton or IPOPT.

The Fokker 50 of this page was flown by JSBSim. Its elevator follows the command with a lag of 0.12 s, which the
aircraft file does not contain.
"""

from importlib.resources import files

import matplotlib.pyplot as plt
import numpy as np

import casid as cs

# %%
# The diagnosis
# -------------
# Three records are fitted, one is held out.
demo = files("casid.cli").joinpath("demo")
aircraft = cs.Aircraft.read(str(demo / "aircraft.toml"))
records = cs.read_records(str(demo / "m*.csv"))
diagnosis = cs.diagnose(aircraft, records[:3], hold_out=records[3:])
extended = diagnosis.extended_aircraft
print(diagnosis.causes[0].sentence)

# %%
# The extended aircraft as a model
# --------------------------------
# The lag has a parameter of its own name. `extended.write("extended.toml")` and `casid estimate --free` take the same.
model = cs.aircraft_model(extended)
lag = "actuator_lag(delta_e)"
print({name: round(value, 4) for name, value in model.nominal.items() if name == lag})

# %%
# Estimate it again from far away
# -------------------------------
# The lag starts at 0.03 s, a quarter of the truth; the derivatives of pitch and lift are free beside it.
free = [lag, "Cm_*", "CL_*", "CD_*"]
pitching = records[:1]


def estimated(method, solver=None, constraints=()) -> cs.Fit:
    problem = cs.Problem(model, pitching, free=free, start={lag: 0.03}, constraints=constraints)
    return cs.solve(problem, method, solver or cs.GaussNewton())


ways = {
    "single shooting": estimated(cs.SingleShooting()),
    "multiple shooting": estimated(cs.MultipleShooting(interval=25)),
    "multiple shooting, IPOPT": estimated(cs.MultipleShooting(interval=25), cs.Ipopt()),
}
for name, fit in ways.items():
    one = fit[lag]
    print(f"{name:25s} {one.value:.4f} +- {one.std_corrected:.4f} s, {fit.iterations:3d} steps, {fit.seconds:5.2f} s")

# %%
# All three end at the same lag: the transcription changes the way, not the estimate.
#
# A limit on the lag
# ------------------
# A data sheet says that the actuator is faster than 0.1 s. The limit holds the lag, its interval has one side, and
# the price is told by the likelihood.
held = estimated(cs.MultipleShooting(interval=25), constraints=[cs.limit_parameter(lag, upper=0.1)])
best = ways["multiple shooting"]
print(f"lag {held[lag].value:.4f} s, interval {held[lag].interval[0]:.4f} to {held[lag].interval[1]:.4f} s")
print(f"2 ln L is lower by {2.0 * (best.log_likelihood - held.log_likelihood):.0f}: the data sheet is contradicted")

# %%
# What the lag explains
# ---------------------
# The same estimation without it leaves an error in the pitch rate at every step of the elevator.
without = cs.solve(cs.Problem(cs.aircraft_model(aircraft), pitching, free=free[1:]), cs.MultipleShooting(interval=25))
record = pitching[0]
channel = model.outputs.index("q")
fig, ax = plt.subplots()
for label, fit in (("without a lag", without), ("with the lag", best)):
    ax.plot(record.t, np.degrees(record["q"] - fit.predictions[record.name][:, channel]), label=label, linewidth=1.0)
ax.set(xlabel="time [s]", ylabel="measured minus simulated pitch rate [deg/s]")
ax.legend()
plt.show()
