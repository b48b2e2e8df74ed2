"""
Four tanks and a leak
=====================

Two pumps fill four tanks, the upper ones run into the lower ones. One of them has a leak that the model does not know.
"""

import matplotlib.pyplot as plt
import numpy as np
from scipy.integrate import solve_ivp

import casid as cs

AREA, G = (28.0, 32.0, 28.0, 32.0), 981.0  # cm2, cm/s2
VALUES = {"a1": 0.071, "a2": 0.057, "a3": 0.071, "a4": 0.057, "k1": 3.33, "k2": 3.35}
TANKS = ("h1", "h2", "h3", "h4")


def rates(h, v1, v2, p, leak=0.0):
    """What runs in and out of each tank, over its area; the same for numbers and for the symbols of a model."""
    out = [p[f"a{i + 1}"] * (2.0 * G) ** 0.5 * (h[i] ** 2 + 1e-4) ** 0.25 for i in range(4)]
    into = (out[2] + 0.7 * p["k1"] * v1, out[3] + 0.6 * p["k2"] * v2, 0.4 * p["k2"] * v2, 0.3 * p["k1"] * v1)
    lost = (0.0, 0.0, leak * AREA[2] * (h[2] ** 2 + 1e-4) ** 0.25, 0.0)
    return [(i - o - x) / a for i, o, x, a in zip(into, out, lost, AREA, strict=True)]


def flown(name, seed):
    """600 s of the true plant, its third tank leaking, levels read to half a millimetre."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, 600.0, 4.0)
    v1, v2 = (np.interp(t, np.arange(0.0, 700.0, 60.0), rng.uniform(1.5, 5.0, 12)) for _ in range(2))
    h = solve_ivp(
        lambda now, x: rates(x, np.interp(now, t, v1), np.interp(now, t, v2), VALUES, leak=0.035),
        (0.0, 600.0),
        rng.uniform([10.0, 10.0, 2.0, 2.0], [14.0, 14.0, 4.0, 4.0]),
        t_eval=t,
        max_step=4.0,
    ).y
    levels = dict(zip(TANKS, h + rng.normal(scale=0.05, size=h.shape), strict=True))
    return cs.Record(name=name, t=t, channels={"v1": v1, "v2": v2, **levels})


records = [flown(f"m{k}", k) for k in range(3)]

# %%
# The simulation. Its constants are known to 5 %. A leak would go with the root of a level: that may be asked for.
model = cs.define_model(
    "four tanks",
    states=TANKS,
    inputs=("v1", "v2"),
    parameters=VALUES,
    prior_std={name: 0.05 * value for name, value in VALUES.items()},
    outputs=TANKS,
    dynamics=lambda s: dict(zip(TANKS, rates([s.h1, s.h2, s.h3, s.h4], s.v1, s.v2, vars(s)), strict=True)),
    output=lambda s: {name: getattr(s, name) for name in TANKS},
)
library = cs.Library(regressors={f"sqrt({h})": lambda s, h=h: (getattr(s, h) ** 2 + 1e-4) ** 0.25 for h in TANKS[2:]})
diagnosis = cs.diagnose(model, records, library=library)
print(diagnosis)

# %%
# What each step takes off the error on the held-out record: values re-estimated, the cause added.
diagnosis.budget.plot()
plt.show()
