"""
Diodes in a circuit: an algebraic state
=======================================

A capacitor is charged through a resistor and two diodes in opposite directions. The current fulfils an equation that no
formula solves for it: it is an algebraic state. How large are the resistor, the diodes' current and the capacitor?
"""

import casadi as ca
import matplotlib.pyplot as plt
import numpy as np

import casid as cs

TRUTH = {"R": 0.5, "I0": 0.02, "C": 3.0}  # kilohm, milliampere, microfarad; times in ms
V_THERMAL = 0.05  # V

# %%
# ``algebraic`` has a value of the usual size, ``balance`` the expression that is zero: the sum of voltages in the loop.
model = cs.define_model(
    "diodes",
    states=("v",),
    inputs=("source",),
    parameters={"R": 1.0, "I0": 0.1, "C": 1.0},
    outputs=("v", "current"),
    algebraic={"i": 0.1},
    dynamics=lambda s: {"v": s.i / s.C},
    output=lambda s: {"v": s.v, "current": s.i},
    balance=lambda s: {"i": s.source - s.v - s.R * s.i - V_THERMAL * np.arcsinh(s.i / (2.0 * s.I0))},
)

# %%
# The measurement comes from IDAS, which solves differential and algebraic equations together.
t = np.linspace(0.0, 20.0, 201)
source = np.sin(0.8 * t) * np.minimum(t / 5.0, 1.0)
v, i, share = ca.SX.sym("v"), ca.SX.sym("i"), ca.SX.sym("share")
u0, u1 = ca.SX.sym("u0"), ca.SX.sym("u1")
loop = u0 + share * (u1 - u0) - v - TRUTH["R"] * i - V_THERMAL * ca.asinh(i / (2.0 * TRUTH["I0"]))
dae = {"x": v, "z": i, "t": share, "p": ca.vertcat(u0, u1), "ode": (t[1] - t[0]) * i / TRUTH["C"], "alg": loop}
step = ca.integrator("step", "idas", dae, 0.0, 1.0, {"reltol": 1e-9, "abstol": 1e-11})
states, current, state = [0.0], [0.0], 0.0
for before, after in zip(source[:-1], source[1:], strict=True):
    end = step(x0=state, z0=current[-1], p=[before, after])
    state = float(end["xf"])
    states.append(state)
    current.append(float(end["zf"]))
rng = np.random.default_rng(2)
record = cs.Record(
    name="m",
    t=t,
    channels={
        "source": source,
        "v": np.array(states) + 0.005 * rng.standard_normal(len(t)),
        "current": np.array(current) + 0.02 * rng.standard_normal(len(t)),
    },
)

# %%
# The estimation solves the balance at every stage of the integration, and at the first sample.
fit = cs.solve(cs.Problem(model, record, free=["*"], log=["*"]))
print(fit)

# %%
# Measured and fitted current.
plt.plot(t, record["current"], ".", label="measured")
plt.plot(t, fit.predictions["m"][:, 1], label="fitted")
plt.xlabel("time [ms]")
plt.ylabel("current [mA]")
plt.legend()
plt.show()
