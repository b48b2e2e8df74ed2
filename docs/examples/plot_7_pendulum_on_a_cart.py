"""
A camera that is late
=====================

A pendulum hangs from a cart, and a camera reads its angle. The camera is 50 ms late, which the model does not know.
"""

import matplotlib.pyplot as plt
import numpy as np
from scipy.integrate import solve_ivp

import casid as cs

VALUES = {"M": 1.0, "m": 0.3, "l": 0.5, "b": 0.8}  # masses [kg], length [m], friction of the cart [N s/m]
LATE = 0.05  # s


def rates(v, phi, w, F, p):
    """Of position, speed, angle and angular rate; the same for numbers and for the symbols of a model."""
    s, c = np.sin(phi), np.cos(phi)
    pushed = (F - p["b"] * v + p["m"] * s * (p["l"] * w * w + 9.81 * c)) / (p["M"] + p["m"] * s * s)
    return {"x": v, "v": pushed, "phi": w, "w": -(pushed * c + 9.81 * s) / p["l"]}


def flown(name, seed):
    """10 s of the true cart, pushed to and fro."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, 10.0, 0.02)
    F = np.interp(t, np.arange(0.0, 11.0, 0.5), rng.uniform(-4.0, 4.0, 22))
    truth = solve_ivp(
        lambda now, x: list(rates(x[1], x[2], x[3], np.interp(now, t, F), VALUES).values()),
        (0.0, 10.0),
        [0.0, 0.0, 0.1, 0.0],
        t_eval=t,
        max_step=0.02,
    ).y
    seen = np.interp(t - LATE, t, truth[2])
    noise = rng.normal(scale=[[0.003], [0.005]], size=(2, len(t)))
    return cs.Record(name=name, t=t, channels={"F": F, "x": truth[0] + noise[0], "phi": seen + noise[1]})


records = [flown(f"m{k}", k) for k in range(3)]

# %%
# The simulation. What a position and an angle are is beyond doubt; everything else may be wrong.
model = cs.define_model(
    "pendulum on a cart",
    states=("x", "v", "phi", "w"),
    inputs=("F",),
    parameters={"M": 1.03, "m": 0.29, "l": 0.51, "b": 0.75},
    prior_std={"M": 0.05},
    outputs=("x", "phi"),
    dynamics=lambda s: rates(s.v, s.phi, s.w, s.F, vars(s)),
    output=lambda s: {"x": s.x, "phi": s.phi},
    state_scale={"v": 0.5, "w": 2.0},
)
diagnosis = cs.diagnose(model, records, exact=("x", "phi"))
print(diagnosis)

# %%
# What each step takes off the error on the held-out record: values re-estimated, the cause added.
diagnosis.budget.plot()
plt.show()
