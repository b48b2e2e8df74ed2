"""
Airframes of one type: parameters drawn from a distribution
===========================================================

Ten airframes of one type fly a short aileron doublet each. Their ailerons are not equally effective. One value for all
is wrong, and one for each is uncertain, as the records are short. ``spread`` takes the middle way.
"""

import matplotlib.pyplot as plt
import numpy as np

import casid as cs

model = cs.define_model(
    "roll",
    states=("p",),
    inputs=("delta_a",),
    parameters={"L_p": -2.0, "L_delta_a": -10.0},
    outputs=("p",),
    dynamics=lambda s: {"p": s.L_p * s.p + s.L_delta_a * s.delta_a},
    output=lambda s: {"p": s.p},
)

# %%
# The truth: L_delta_a is -14 on average, with a standard deviation of 1.5 between airframes.
rng = np.random.default_rng(11)
effective = -14.0 + 1.5 * rng.standard_normal(10)
t = 0.04 * np.arange(50)
doublet = np.where(t < 0.8, 0.05, np.where(t < 1.6, -0.05, 0.0))
records = []
for number, value in enumerate(effective):
    still = cs.Record(name=f"{number + 1}", t=t, channels={"delta_a": doublet}, hold="held")
    flown = cs.simulate(model, still, [0.0], {"L_p": -3.0, "L_delta_a": value}).as_record()
    records.append(flown.with_channels(p=flown["p"] + 0.06 * rng.standard_normal(len(t))))

# %%
# Once with a spread, whose size is expected to be a few per second squared, and once with each record for itself.
posed = {"free": ["L_p"], "per_record": ["L_delta_a"]}
fit = cs.solve(cs.Problem(model, records, spread={"L_delta_a": 5.0}, **posed))
alone = cs.solve(cs.Problem(model, records, **posed))
print(fit)

# %%
# The estimates with a spread are nearer to the truth.
names = [f"L_delta_a[{record.name}]" for record in records]
for label, one in (("each for itself", alone), ("with a spread", fit)):
    off = np.array([one.values[name] for name in names]) - effective
    print(f"{label}: rms error {np.sqrt(np.mean(off**2)):.2f} 1/s2")

number = np.arange(1, 11)
for label, one, shift in (("each for itself", alone, -0.1), ("with a spread", fit, 0.1)):
    values = [one.values[name] for name in names]
    plt.errorbar(number + shift, values, [one[name].std for name in names], fmt="o", capsize=3, label=label)
plt.plot(number, effective, "k_", markersize=18, label="truth")
plt.axhline(fit.population["L_delta_a"].mean, color="grey", linewidth=1, label="mean")
plt.xticks(number)
plt.xlabel("airframe")
plt.ylabel(r"$L_{\delta_a}$ [1/s²]")
plt.legend()
plt.show()
