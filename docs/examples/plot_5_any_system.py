"""
What is wrong with this motor?
==============================

A DC motor whose amplifier does nothing below 1 V, and a model that does not know it.
"""

import matplotlib.pyplot as plt
import numpy as np
from scipy.integrate import solve_ivp

import casid as cs

R, K, J, b = 2.0, 0.1, 2e-3, 1e-3  # ohm, N m/A, kg m2, N m s


def flown(name, seed):
    """The true motor: 8 s of steps of voltage, and the noisy speed and current."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, 8.0, 0.01)
    V = np.interp(t, np.arange(0.0, 9.0, 0.5), rng.uniform(-8.0, 8.0, 18))
    acts = np.sign(V) * np.maximum(np.abs(V) - 1.0, 0.0)
    speed = solve_ivp(
        lambda now, x: (K * (np.interp(now, t, acts) - K * x) / R - b * x) / J,
        (0.0, 8.0),
        [0.0],
        t_eval=t,
        max_step=0.01,
    ).y[0]
    current = (acts - K * speed) / R
    noise = rng.normal(scale=[[0.3], [0.02]], size=(2, len(t)))
    return cs.Record(name=name, t=t, channels={"V": V, "omega": speed + noise[0], "i": current + noise[1]})


records = [flown(f"m{k}", k) for k in range(4)]

# %%
# The simulation: friction and inertia roughly known, the amplifier taken as it should be.
model = cs.define_model(
    "DC motor",
    states=("omega",),
    inputs=("V",),
    parameters={"R": 2.1, "K": 0.105, "J": 2.1e-3, "b": 0.9e-3},
    prior_std={"J": 1e-4},
    outputs=("omega", "i"),
    dynamics=lambda s: {"omega": (s.K * (s.V - s.K * s.omega) / s.R - s.b * s.omega) / s.J},
    output=lambda s: {"omega": s.omega, "i": (s.V - s.K * s.omega) / s.R},
    state_scale={"omega": 30.0},
)

# %%
# Reality may differ at every state derivative, input and reading. The last record is held back.
diagnosis = cs.diagnose(model, records)
print(diagnosis)

# %%
# What each step takes off the error on the held-out record: values re-estimated, the cause added.
diagnosis.budget.plot()
plt.show()
