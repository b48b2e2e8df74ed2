"""
One patient is different
========================

A drug goes from blood into tissue and back. In one of four patients it is eliminated faster than in the others.
"""

import matplotlib.pyplot as plt
import numpy as np
from scipy.integrate import solve_ivp

import casid as cs

VALUES = {"k10": 0.25, "k12": 0.35, "k21": 0.30, "V1": 20.0, "V2": 25.0}  # 1/h, 1/h, 1/h, l, l
FASTER = {"b": 0.08}  # 1/h more elimination, by patient


def rates(A1, A2, infusion, p):
    """Of the amounts in blood and tissue [mg/h]; the same for numbers and for the symbols of a model."""
    exchange = p["k12"] * A1 - p["k21"] * A2
    return infusion - p["k10"] * A1 - exchange, exchange


def treated(name, seed):
    """48 hours of one patient: an infusion [mg/h] and two noisy concentrations [mg/l]."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, 48.0, 0.2)
    infusion = np.interp(t, np.arange(0.0, 50.0, 4.0), rng.uniform(0.0, 60.0, 13))
    p = VALUES | {"k10": VALUES["k10"] + FASTER.get(name, 0.0)}
    A = solve_ivp(
        lambda now, x: rates(x[0], x[1], np.interp(now, t, infusion), p),
        (0.0, 48.0),
        [20.0, 30.0],
        t_eval=t,
        max_step=0.2,
    ).y
    noise = rng.normal(scale=0.05, size=(2, len(t)))
    return cs.Record(
        name=name,
        t=t,
        channels={"infusion": infusion, "c1": A[0] / p["V1"] + noise[0], "c2": A[1] / p["V2"] + noise[1]},
    )


records = [treated(name, k) for k, name in enumerate("abcd")]

# %%
# The simulation. Volumes are known to 5 %, without which no concentration says an amount.
model = cs.define_model(
    "two compartments",
    states=("A1", "A2"),
    inputs=("infusion",),
    parameters=VALUES,
    prior_std={"V1": 1.0, "V2": 1.25},
    outputs=("c1", "c2"),
    dynamics=lambda s: dict(zip(("A1", "A2"), rates(s.A1, s.A2, s.infusion, vars(s)), strict=True)),
    output=lambda s: {"c1": s.A1 / s.V1, "c2": s.A2 / s.V2},
    state_scale={"A1": 100.0, "A2": 100.0},
)
diagnosis = cs.diagnose(model, records[:3], records[3:])
print(diagnosis)

# %%
# What is in the blood of each patient.
for record in records:
    plt.plot(record.t, record["c1"], label=record.name)
plt.xlabel("time [h]")
plt.ylabel("concentration in the blood [mg/l]")
plt.legend()
plt.show()
