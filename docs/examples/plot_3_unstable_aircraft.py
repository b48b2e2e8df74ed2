"""
An unstable aircraft
====================

The short period of an aircraft that only its control law keeps in the air. One long simulation departs before it has
learnt anything; short ones, joined by equations, find the derivatives.
"""

import matplotlib.pyplot as plt
import numpy as np
from scipy.linalg import expm

import casid as cs

truth = {"Zw": -1.42, "Mw": 0.22, "Mq": -3.7, "Md": -12.8}

# %%
# Flown with feedback of pitch rate and heave velocity; the recorded elevator is what the law and the pilot did.
dt, n = 0.02, 500
a = np.array([[truth["Zw"], 40.0], [truth["Mw"], truth["Mq"]]])
b = np.array([0.0, truth["Md"]])
step = expm(dt * np.block([[a, b[:, None]], [np.zeros((1, 3))]]))
print("poles of the aircraft alone:", np.linalg.eigvals(a).round(2))
x, states, inputs = np.zeros(2), [], []
for i in range(n):
    pilot = 0.03 * np.sign(np.sin(0.9 * i * dt)) * (i * dt > 1.0)
    elevator = 0.03 * x[0] + 0.2 * x[1] + pilot
    states.append(x)
    inputs.append(elevator)
    x = step[:2, :2] @ x + step[:2, 2] * elevator
states = np.array(states) + np.random.default_rng(3).normal(scale=[0.1, 0.004], size=(n, 2))
t = dt * np.arange(n)
record = cs.Record(
    name="flight", t=t, channels={"w": states[:, 0], "q": states[:, 1], "delta_e": np.array(inputs)}, hold="held"
)

# %%
# From half of the true values.
model = cs.define_model(
    "unstable short period",
    states=("w", "q"),
    inputs=("delta_e",),
    parameters={name: 0.5 * value for name, value in truth.items()},
    outputs=("w", "q"),
    dynamics=lambda s: {"w": s.Zw * s.w + 40.0 * s.q, "q": s.Mw * s.w + s.Mq * s.q + s.Md * s.delta_e},
    output=lambda s: {"w": s.w, "q": s.q},
)
problem = cs.Problem(model, [record], free=["*"], noise={"w": 0.1, "q": 0.004})
fit = cs.solve(problem, cs.MultipleShooting(interval=10))
print(fit)
print("truth:", truth)

# %%
# Measured and simulated pitch rate.
plt.plot(t, states[:, 1], ".", markersize=2, label="measured")
plt.plot(t, fit.predictions["flight"][:, 1], label="estimated model")
plt.xlabel("time [s]")
plt.ylabel("q [rad/s]")
plt.legend()
plt.show()
