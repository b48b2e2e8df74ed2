"""
Counted once a year: a model in discrete time
=============================================

Salmon spawn once in their life, and the next generation returns years later. Ricker's map gives its number from that of
this one. The counts have an error.
"""

import matplotlib.pyplot as plt
import numpy as np

import casid as cs

TRUTH = {"r": 1.1, "k": 40.0}  # growth per generation, thousands that replace themselves

# %%
# With ``period=`` a model is in discrete time: ``dynamics`` returns the state one sample later.
model = cs.define_model(
    "ricker",
    states=("n",),
    inputs=("caught",),
    parameters={"r": 0.8, "k": 30.0},
    outputs=("counted",),
    period=1.0,
    dynamics=lambda s: {"n": (s.n - s.caught) * np.exp(s.r * (1.0 - (s.n - s.caught) / s.k))},
    output=lambda s: {"counted": s.n},
    state_scale={"n": 20.0},
)

# %%
# 40 generations; the catch is known, the count has a standard deviation of four thousand.
rng = np.random.default_rng(7)
generation = np.arange(40.0)
n, caught = [15.0], rng.uniform(0.0, 0.6, 40)
for share in caught[:-1]:
    left = n[-1] * (1.0 - share)
    n.append(left * np.exp(TRUTH["r"] * (1.0 - left / TRUTH["k"])))
n = np.array(n)
record = cs.Record(
    name="river", t=generation, channels={"caught": caught * n, "counted": n + rng.normal(scale=4.0, size=40)}
)
problem = cs.Problem(
    model, record, free=["r", "k"], measured={"n": "counted"}, constraints=[cs.limit_parameter("k", lower=1.0)]
)

# %%
# Output error simulates all generations from the first.
fit = cs.solve(problem)
print(fit)

# %%
# Equation error predicts each count from the one before, as if that were exact. Its standard errors are larger here,
# and do not contain what an error of the count before does.
print(cs.solve(cs.Problem(model, record, free=["r", "k"], measured={"n": "counted"}, cost=cs.EquationError())))

# %%
# Counts, the truth and the fitted simulation.
plt.plot(generation, record["counted"], ".", label="counted")
plt.plot(generation, n, label="truth")
plt.plot(generation, fit.predictions["river"][:, 0], "--", label="fitted")
plt.xlabel("generation")
plt.ylabel("salmon, thousands")
plt.legend()
plt.show()
