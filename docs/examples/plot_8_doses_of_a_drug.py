"""
Three doses of a drug: events at known times
============================================

A patient takes a tablet three times a day. Every dose is an event, at which an amount enters the gut at once. From the
concentration in the blood, read at other times, one asks how fast the drug is absorbed and eliminated.
"""

import matplotlib.pyplot as plt
import numpy as np

import casid as cs

TRUTH = {"absorption": 1.2, "elimination": 0.25, "V": 30.0}  # 1/h, 1/h, l

# %%
# ``events`` says what a dose does to the states; the record says when.
model = cs.define_model(
    "tablet",
    states=("gut", "blood"),
    inputs=(),
    parameters={"absorption": 0.8, "elimination": 0.15, "V": 25.0, "dose": 100.0},
    outputs=("c",),
    dynamics=lambda s: {
        "gut": -s.absorption * s.gut,
        "blood": s.absorption * s.gut - s.elimination * s.blood,
    },
    output=lambda s: {"c": s.blood / s.V},
    events=lambda s: {"tablet": {"gut": s.gut + s.dose}},
    state_scale={"gut": 100.0, "blood": 100.0},
)
t = np.array([0.0, 0.5, 1.0, 2.0, 4.0, 6.0, 7.5, 8.5, 9.5, 11.0, 13.0, 15.5, 16.5, 18.0, 20.0, 24.0])
taken = cs.Record(name="day", t=t, channels={}, events={"tablet": [0.25, 8.0, 15.75]})
truth = cs.simulate(model, taken, [0.0, 0.0], TRUTH, substeps=20)
record = taken.with_channels(c=truth.output("c") + 0.05 * np.random.default_rng(3).standard_normal(len(t)))

# %%
# Before the first tablet there is none of the drug in the body. The two rates exchanged, with another volume, explain
# the readings equally well (flip-flop in pharmacology). That absorption is the faster one is known beforehand.
fit = cs.solve(
    cs.Problem(
        model,
        record,
        free=["absorption", "elimination", "V"],
        log=["*"],
        constraints=[cs.limit_function(lambda s: s.absorption / s.elimination, lower=1.0)],
        initial_state=cs.InitialState(value={"gut": 0.0, "blood": 0.0}, std={"gut": 0.0, "blood": 0.0}),
    )
)
print(fit)

# %%
# Steps of the integration end at the events, also between readings.
fine = cs.Record(name="fine", t=np.linspace(0.0, 24.0, 400), channels={}, events=record.events)
fitted = cs.simulate(model, fine, [0.0, 0.0], dict(fit.values), substeps=4)
plt.plot(fine.t, fitted.output("c"), label="fitted")
plt.plot(record.t, record["c"], "o", label="read")
for time in record.events["tablet"]:
    plt.axvline(time, color="grey", linestyle=":", label="tablet" if time < 1.0 else None)
plt.xlabel("time [h]")
plt.ylabel("concentration [mg/l]")
plt.legend()
plt.show()
