"""
A pendulum: length and friction
===============================

Any dynamic system is a model: states, inputs, parameters, outputs, and two functions. A pendulum swings; its angle is
measured with noise. Which length and which friction explain it?
"""

import casadi as ca
import matplotlib.pyplot as plt
import numpy as np
from scipy.integrate import solve_ivp

import casid as cs

G = 9.81
truth = {"length": 0.8, "friction": 0.25}

# %%
# The measurement comes from another simulator, with the true values.
t = np.arange(0.0, 10.0, 0.02)
swing = solve_ivp(
    lambda _, x: [x[1], -G / truth["length"] * np.sin(x[0]) - truth["friction"] * x[1]],
    (0.0, 10.0),
    [1.2, 0.0],
    t_eval=t,
    rtol=1e-9,
)
angle = swing.y[0] + 0.02 * np.random.default_rng(1).standard_normal(len(t))
record = cs.Record(name="swing", t=t, channels={"angle": angle, "torque": 0.0 * t})


# %%
# The model, with a start that is far away. The rate is not measured: its first guess is the slope of the angle.
def slope(values: np.ndarray, t: np.ndarray) -> np.ndarray:
    return np.gradient(np.convolve(values, np.ones(25) / 25, mode="same"), t)


model = cs.define_model(
    "pendulum",
    states=("angle", "rate"),
    inputs=("torque",),
    parameters={"length": 2.0, "friction": 0.05},
    outputs=("angle",),
    dynamics=lambda s: {
        "angle": s.rate,
        "rate": -G / s.length * ca.sin(s.angle) - s.friction * s.rate + s.torque,
    },
    output=lambda s: {"angle": s.angle},
    guess=lambda record: np.stack([record["angle"], slope(record["angle"], record.t)], axis=1),
)
fit = cs.solve(cs.Problem(model, [record], free=["*"]), cs.MultipleShooting(interval=20))
print(fit)

# %%
# Measured and simulated.
plt.plot(t, angle, ".", markersize=2, label="measured")
plt.plot(t, fit.predictions["swing"][:, 0], label="estimated model")
plt.xlabel("time [s]")
plt.ylabel("angle [rad]")
plt.legend()
plt.show()
