"""
A short period by frequency
===========================

A frequency sweep of the elevator, and what estimation in the frequency domain makes of it: the short period's damping,
frequency and equivalent time delay with their precision, the derivatives, and the loss of half an elevator in flight.
"""

import matplotlib.pyplot as plt
import numpy as np
from scipy.signal import chirp

import casid as cs

truth = {"Za": -1.2, "Zde": -0.15, "Ma": -8.0, "Mq": -1.8, "Mde": -9.0}
model = cs.define_model(
    "short period",
    states=["alpha", "q"],
    inputs=["delta_e"],
    parameters=truth,
    outputs=["alpha", "q"],
    dynamics=lambda s: {
        "alpha": s.Za * s.alpha + s.q + s.Zde * s.delta_e,
        "q": s.Ma * s.alpha + s.Mq * s.q + s.Mde * s.delta_e,
    },
    output=lambda s: {"alpha": s.alpha, "q": s.q},
)
rng = np.random.default_rng(1)
t = np.arange(0.0, 90.0, 0.02)


def flown(name, elevator, values=truth, start=(0.0, 0.0)):
    """A simulated flight with white noise on what is measured."""
    record = cs.Record(name=name, t=t, channels={"delta_e": elevator})
    clean = cs.simulate(model, record, np.array(start), values).as_record(name)
    noisy = {"alpha": clean["alpha"] + rng.normal(0.0, 2e-3, len(t)), "q": clean["q"] + rng.normal(0.0, 4e-3, len(t))}
    return clean.with_channels(**noisy)


# %%
# The sweep goes from 0.3 to 12 rad/s. The pilot's command reaches the surface 60 ms later; the command is recorded.
command = 0.02 * chirp(t, 0.3 / (2 * np.pi), t[-1], 12.0 / (2 * np.pi), method="logarithmic", phi=-90.0)
sweep = flown("sweep", np.interp(t - 0.06, t, command, left=0.0)).with_channels(command=command)
responses = [
    cs.frequency_response(sweep, "command", output, windows=[30.0, 20.0, 10.0, 5.0]) for output in ("q", "alpha")
]

# %%
# The low-order equivalent system of the pitch rate has the form of the handbooks. The angle of attack has a form of
# its own, with a zero, and shares damping and frequency.
form = {
    "q": cs.TransferFunction(gain="K_q", zeros=["1/T_theta2"], pole_pairs=[("zeta_sp", "omega_sp")], delay="tau"),
    "alpha": cs.TransferFunction(
        gain="K_alpha", zeros=["1/T_alpha"], pole_pairs=[("zeta_sp", "omega_sp")], delay="tau"
    ),
}
fit = cs.fit_transfer_functions(responses, form)
print(fit)
fit.plot()
plt.show()

# %%
# The truth is known here: eigenvalues of the matrix, and the zero of its numerator.
root = np.linalg.eigvals(np.array([[truth["Za"], 1.0], [truth["Ma"], truth["Mq"]]]))[0]
zero = -truth["Za"] + truth["Ma"] * truth["Zde"] / truth["Mde"]
print(f"omega_sp {abs(root):.3f} rad/s, zeta_sp {-root.real / abs(root):.3f}, 1/T_theta2 {zero:.3f} 1/s, delay 0.060 s")

# %%
# The derivatives straight from the record, in a band, with the surface as the input. The model is linear and its step
# from sample to sample exact. `precision` says what the data know.
sweep = sweep.with_channels(delta_e=np.interp(t - 0.06, t, command, left=0.0))
start = {name: 0.6 * value for name, value in truth.items()}
problem = cs.Problem(model, [sweep], free=["*"], start=start, cost=cs.FourierOutputError(band=(0.3, 12.0)))
estimate = cs.solve(problem)
print(cs.precision(estimate))
estimate.plot()
plt.show()

# %%
# In flight: half of the elevator is lost at 45 s, in the middle of a multisine. The estimates come with the samples,
# and old ones are forgotten within some 8 s. No derivative is measured: the transforms are multiplied by j omega.
multisine = 0.01 * np.sin(np.outer(t, np.arange(0.5, 8.0, 0.37)) + np.arange(21) ** 2).sum(axis=1)
broken = flown("after", multisine * np.where(t < 45.0, 1.0, 0.5)).with_channels(delta_e=multisine)
tracked = list(
    cs.track_derivatives(model, broken, free=["Ma", "Mq", "Mde"], omega=np.arange(0.5, 9.0, 0.3), memory=8.0)
)
times = np.array([now.t for now in tracked])
figure, axes = plt.subplots(3, 1, sharex=True, figsize=(7.0, 5.5), layout="constrained")
for ax, name in zip(axes, ("Mde", "Ma", "Mq"), strict=True):
    value, std = (np.array([getattr(now, what)[name] for now in tracked]) for what in ("values", "std"))
    ax.fill_between(times, value - 2 * std, value + 2 * std, alpha=0.25, lw=0.0, label="± 2 standard deviations")
    ax.plot(times, value, label="tracked")
    lost = 0.5 if name == "Mde" else 1.0
    ax.plot(t, np.where(t < 45.0, 1.0, lost) * truth[name], "k--", lw=1.0, label="truth")
    ax.set_ylabel(name)
    ax.set_ylim(truth[name] - 2.5, truth[name] + (6.0 if name == "Mde" else 2.5))
axes[0].legend(loc="lower right", ncols=3)
axes[-1].set_xlabel("t [s]")
plt.show()
