"""
Grass is scarce
===============

Prey and predators after Lotka and Volterra, whose prey never starves. In truth, grass is scarce.
"""

import matplotlib.pyplot as plt
import numpy as np
from scipy.integrate import solve_ivp

import casid as cs

VALUES = {"a": 1.0, "b": 0.5, "c": 0.4, "d": 0.6}  # 1/year
SCARCE = 0.06  # 1/year: loss of prey per thousand of its own


def rates(prey, pred, harvest, p, scarce=0.0):
    """Of both populations; the same for numbers and for the symbols of a model."""
    meetings = prey * pred
    return p["a"] * prey - p["b"] * meetings - harvest * prey - scarce * prey**2, p["c"] * meetings - p["d"] * pred


def counted(name, seed):
    """20 years of counts, in thousands, and the share of the prey that was harvested."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, 20.0, 0.1)
    harvest = np.interp(t, np.arange(0.0, 22.0, 2.0), rng.uniform(0.0, 0.5, 11))
    truth = solve_ivp(
        lambda now, x: rates(x[0], x[1], np.interp(now, t, harvest), VALUES, SCARCE),
        (0.0, 20.0),
        rng.uniform([0.8, 0.8], [2.5, 2.0]),
        t_eval=t,
        max_step=0.1,
    ).y
    counts = truth + rng.normal(scale=0.03, size=truth.shape)
    return cs.Record(name=name, t=t, channels={"harvest": harvest, "prey": counts[0], "pred": counts[1]})


records = [counted(f"m{k}", k) for k in range(3)]

# %%
# The simulation, of which nothing is known but where its values begin.
model = cs.define_model(
    "prey and predators",
    states=("prey", "pred"),
    inputs=("harvest",),
    parameters={"a": 0.95, "b": 0.5, "c": 0.42, "d": 0.6},
    outputs=("prey", "pred"),
    dynamics=lambda s: dict(zip(("prey", "pred"), rates(s.prey, s.pred, s.harvest, vars(s)), strict=True)),
    output=lambda s: {"prey": s.prey, "pred": s.pred},
)
diagnosis = cs.diagnose(model, records)
print(diagnosis)

# %%
# What each step takes off the error on the held-out record: values re-estimated, the cause added.
diagnosis.budget.plot()
plt.show()
