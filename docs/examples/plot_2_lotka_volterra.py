"""
Prey and predators
==================

Lotka-Volterra: four rates from two noisy counts, single against multiple shooting from a start that is off by a half.
"""

import matplotlib.pyplot as plt
import numpy as np
from scipy.integrate import solve_ivp

import casid as cs

truth = {"growth": 1.1, "eaten": 0.4, "fed": 0.1, "death": 0.4}


def rates(_, x):
    return [
        truth["growth"] * x[0] - truth["eaten"] * x[0] * x[1],
        truth["fed"] * x[0] * x[1] - truth["death"] * x[1],
    ]


t = np.arange(0.0, 30.0, 0.1)
exact = solve_ivp(rates, (0.0, 30.0), [10.0, 5.0], t_eval=t, rtol=1e-9).y.T
counts = exact + np.random.default_rng(2).normal(scale=[0.3, 0.15], size=exact.shape)
record = cs.Record(name="years", t=t, channels={"prey": counts[:, 0], "predators": counts[:, 1], "hunting": 0.0 * t})

# %%
# The model begins at wrong rates.
model = cs.define_model(
    "Lotka-Volterra",
    states=("prey", "predators"),
    inputs=("hunting",),
    parameters={name: 1.5 * value for name, value in truth.items()},
    outputs=("prey", "predators"),
    dynamics=lambda s: {
        "prey": s.growth * s.prey - s.eaten * s.prey * s.predators - s.hunting * s.prey,
        "predators": s.fed * s.prey * s.predators - s.death * s.predators,
    },
    output=lambda s: {"prey": s.prey, "predators": s.predators},
)
problem = cs.Problem(model, [record], free=["*"], noise={"prey": 0.3, "predators": 0.15})

# %%
# Short simulations see the data everywhere; one long simulation is far from them after the first cycle.
fit = cs.solve(problem, cs.MultipleShooting(interval=5))
print(fit)
print("truth:", truth)

# %%
# Measured and simulated.
for i, name in enumerate(("prey", "predators")):
    plt.plot(t, counts[:, i], ".", markersize=2, color=f"C{i}")
    plt.plot(t, fit.predictions["years"][:, i], color=f"C{i}", label=name)
plt.xlabel("time [years]")
plt.legend()
plt.show()
