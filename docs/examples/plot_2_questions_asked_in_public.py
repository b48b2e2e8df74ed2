"""
Questions asked in public
=========================

Four questions from the issue trackers of other projects, each answered by a short program.

1. `opty, pull request 249 <https://github.com/csu-hmc/opty/pull/249>`__: the parameters are estimated well, but the
   biases of the measurements are not.
2. `CasADi, issue 353 <https://github.com/casadi/casadi/issues/353>`__: an example of parameter estimation by multiple
   shooting.
3. `data-driven-dynamics, issue 150 <https://github.com/ethz-asl/data-driven-dynamics/issues/150>`__: the estimated drag
   coefficients of a wing make no sense.
4. `rosplane, issue 49 <https://github.com/rosflight/rosplane/issues/49>`__: refine the aerodynamic coefficients of a
   small unmanned aircraft.
"""

from collections.abc import Mapping
from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np
from scipy.integrate import solve_ivp

import casid as cs

# %%
# Biases of the measurements
# --------------------------
# A mass on a spring with a damper is measured five times. In each measurement the sensor of the position has another
# bias. The question moves the bias into a second, shifted copy of the equations of motion. There it competes with the
# motion itself. A bias belongs into the output equation: the mass moves as it does, and the reading is wrong.
rng = np.random.default_rng(249)
truth = {"c": 0.3, "k": 5.0, "l0": 1.0}
biases = [0.5, -0.3, 0.8, -0.7, 0.1]
t = np.arange(0.0, 10.0, 0.05)
measured = []
for i, bias in enumerate(biases):
    start = [1.0 + rng.uniform(-1.0, 1.0), rng.uniform(-1.0, 1.0)]
    motion = solve_ivp(
        lambda _, x: [x[1], -truth["k"] * (x[0] - truth["l0"]) - truth["c"] * x[1]], (0, 10), start, t_eval=t, rtol=1e-9
    )
    reading = motion.y[0] + bias + 0.05 * rng.standard_normal(len(t))
    measured.append(cs.Record(name=f"m{i}", t=t, channels={"x": reading}))

spring = cs.define_model(
    "mass, spring and damper",
    states=("x", "v"),
    inputs=(),
    parameters={"c": 0.1, "k": 3.0, "l0": 1.0, "bias": 0.0},
    outputs=("x",),
    dynamics=lambda s: {"x": s.v, "v": -s.k * (s.x - s.l0) - s.c * s.v},
    output=lambda s: {"x": s.x + s.bias},
)
fit = cs.solve(cs.Problem(spring, measured, free=["c", "k"], per_record=["bias"]))
print(f"c {fit['c'].value:.3f} (true 0.3), k {fit['k'].value:.3f} (true 5)")
for i, bias in enumerate(biases):
    found = fit[f"bias[m{i}]"]
    print(f"bias of m{i}: true {bias:+.2f}, estimated {found.value:+.3f} +- {found.std:.3f}")

# %%
# The five biases are recovered because the model knows the rest length of the spring. If the rest length is unknown as
# well, all biases and the rest length can shift together without any change of the readings. No method can then recover
# the biases: stiffness and damping stay as they are, and the standard deviations of the biases grow a hundredfold.
fit = cs.solve(cs.Problem(spring, measured, free=["c", "k", "l0"], per_record=["bias"]))
for name in ("c", "k", "l0", "bias[m0]", "bias[m1]"):
    print(f"{name}: {fit[name].value:.3f} +- {fit[name].std:.3f}")

# %%
# Multiple shooting in ten lines
# ------------------------------
# The system of CasADi's example ``sysid.py``: a mass on a spring with a cubic part, driven by a random force that is
# constant between the samples. The parameters differ by six orders of magnitude.
truth = {"M": 5.625e-6, "c": 2.3e-4, "k": 1.0, "k_NL": 4.69}
dt, n = 1.0 / 610.1, 1500


def moved(_: float, x: np.ndarray, u: float) -> list[float]:
    """Derivative of the displacement and its rate."""
    return [x[1], (u - truth["k_NL"] * x[0] ** 3 - truth["k"] * x[0] - truth["c"] * x[1]) / truth["M"]]


force = 0.1 * np.random.default_rng(353).random(n)
state, displacement = np.zeros(2), np.zeros(n)
for i in range(n):
    displacement[i] = state[0]
    state = solve_ivp(moved, (0.0, dt), state, args=(force[i],), rtol=1e-8, atol=1e-12).y[:, -1]
displacement += 1e-3 * np.random.default_rng(1).standard_normal(n)
record = cs.Record(name="shaker", t=dt * np.arange(n), channels={"u": force, "y": displacement}, hold="held")

shaker = cs.define_model(
    "shaker",
    states=("y", "rate"),
    inputs=("u",),
    parameters={"M": 5e-6, "c": 2e-4, "k": 1.0, "k_NL": 5.0},
    outputs=("y",),
    dynamics=lambda s: {"y": s.rate, "rate": (s.u - s.k_NL * s.y**3 - s.k * s.y - s.c * s.rate) / s.M},
    output=lambda s: {"y": s.y},
)
fit = cs.solve(cs.Problem(shaker, [record], free=["*"]), cs.MultipleShooting(interval=20))
print(fit)
for name, value in truth.items():
    print(f"{name}: true {value:.4g}, {(fit[name].value - value) / fit[name].std:+.1f} standard deviations away")

# %%
# ``interval`` is the number of samples that share one initial state, and :class:`casid.SingleShooting` has one for the
# whole record. Scaling, derivatives and the initial guess of the unmeasured rate need no statement.

# %%
# Drag coefficients that make no sense
# ------------------------------------
# In the data of the question the angle of attack stays between about -4.3 and -1.5 deg, and one suspicion there is that
# the error of the force is as large as its change. A parabola is estimated whose origin, zero angle of attack, was
# never flown.
truth = {"CD_0": 0.035, "CD_alpha": 0.15, "CD_alpha2": 1.8}
rng = np.random.default_rng(150)


def flight(name: str, lowest: float, highest: float) -> cs.Record:
    """Drag between two angles of attack [deg], with errors of 0.005."""
    alpha = np.radians(rng.uniform(lowest, highest, 400))
    drag = truth["CD_0"] + truth["CD_alpha"] * alpha + truth["CD_alpha2"] * alpha**2
    drag += 0.005 * rng.standard_normal(400)
    return cs.Record(name=name, t=0.05 * np.arange(400), channels={"alpha": alpha, "CD": drag})


def polar(centre: float) -> cs.Model:
    """A parabola about an angle of attack [rad]."""
    return cs.define_regression(
        "polar",
        inputs=("alpha",),
        parameters={"CD_0": 0.03, "CD_alpha": 0.0, "CD_alpha2": 0.0},
        outputs=("CD",),
        output=lambda s: {
            "CD": s.CD_0 + s.CD_alpha * (s.alpha - centre) + s.CD_alpha2 * (s.alpha - centre) ** 2,
        },
    )


narrow, wide = flight("narrow", -4.3, -1.5), flight("wide", -4.3, 8.0)
origin = cs.solve(cs.Problem(polar(0.0), [narrow], free=["*"]))
for name, value in truth.items():
    print(f"{name}: true {value}, estimated {origin[name].value:.3f} +- {origin[name].std:.3f}")

# %%
# The regression is right, but the standard deviations of slope and curvature are about as large as their true values.
# What the data do contain is the drag where the aircraft flew. A constant that is defined there is well determined.
centre = np.radians(-2.9)
flown = cs.solve(cs.Problem(polar(centre), [narrow], free=["*"]))
expected = truth["CD_0"] + truth["CD_alpha"] * centre + truth["CD_alpha2"] * centre**2
print(f"drag at -2.9 deg: true {expected:.4f}, estimated {flown['CD_0'].value:.4f} +- {flown['CD_0'].std:.4f}")

# %%
# Bounds would only move the estimates to the bounds. The remedy is a flight over a wider range of angles of attack.
fit = cs.solve(cs.Problem(polar(0.0), [narrow, wide], free=["*"]))
for name, value in truth.items():
    print(f"{name}: true {value}, estimated {fit[name].value:.4f} +- {fit[name].std:.4f}")


def drag(values: Mapping[str, float], alpha: np.ndarray) -> np.ndarray:
    """Drag coefficient of a parabola about zero angle of attack."""
    return values["CD_0"] + values["CD_alpha"] * alpha + values["CD_alpha2"] * alpha**2


alpha = np.radians(np.linspace(-8.0, 10.0, 100))
plt.plot(np.degrees(narrow["alpha"]), narrow["CD"], ".", markersize=3, label="the narrow flight")
plt.plot(np.degrees(alpha), drag(origin.values, alpha), label="estimated from the narrow flight")
plt.plot(np.degrees(alpha), drag(fit.values, alpha), label="estimated from both flights")
plt.plot(np.degrees(alpha), drag(truth, alpha), "k:", label="true")
plt.xlabel("angle of attack [deg]")
plt.ylabel("drag coefficient")
plt.legend()
plt.show()

# %%
# Coefficients of a small unmanned aircraft
# -----------------------------------------
# The aircraft file has rough coefficients of a small aircraft of 13.5 kg, each uncertain by half of its value. The
# flights are simulated here: an aircraft that differs from the file flies a 3-2-1-1 on the elevator three times.
rough = {
    "CL_0": 0.28,
    "CL_alpha": 3.45,
    "CL_delta_e": 0.36,
    "CD_0": 0.03,
    "CD_alpha": 0.30,
    "Cm_0": -0.02,
    "Cm_alpha": -0.38,
    "Cm_q": -3.6,
    "Cm_delta_e": -0.5,
}
file = cs.Aircraft(
    name="small unmanned aircraft",
    mass=13.5,
    inertia=cs.Inertia(Ixx=0.82, Iyy=1.14, Izz=1.76, Ixz=0.12),
    area=0.55,
    moment_length_lateral=2.9,
    moment_length_pitch=0.19,
    rate_length_lateral=1.45,
    rate_length_pitch=0.095,
    relative_uncertainty=0.5,
    derivatives=rough,
)
truth = rough | {"CL_alpha": 4.4, "Cm_alpha": -0.55, "Cm_q": -5.0, "Cm_delta_e": -0.42}

outputs = ("V", "alpha", "q", "theta", "az")
noise = {"V": 0.3, "alpha": 0.005, "q": 0.01, "theta": 0.005, "az": 0.3}
model = cs.aircraft_model(file, axes="longitudinal", outputs=outputs)
level = cs.trim(file, V=25.0, rho=1.2, values=truth)
start = [25.0 * np.cos(level.alpha), 25.0 * np.sin(level.alpha), 0.0, level.theta]  # u, w, q, theta
steady = {"delta_e": level.delta_e, "thrust": level.thrust, "rho": level.rho}
t = np.arange(0.0, 12.0, 0.02)
edges, signs = np.array([1.0, 2.2, 3.0, 3.4, 3.8]), np.array([0, 1, -1, 1, -1, 0])
rng = np.random.default_rng(49)
records = []
for i, amplitude in enumerate((0.04, -0.04, 0.06)):
    held = {name: np.full(len(t), steady.get(name, 0.0)) for name in model.inputs}
    held["delta_e"] = held["delta_e"] + amplitude * signs[np.searchsorted(edges, t)]
    motion = cs.simulate(model, cs.Record(name=f"m{i}", t=t, channels=held), start, values=truth).as_record(f"m{i}")
    readings = {name: motion[name] + noise[name] * rng.standard_normal(len(t)) for name in outputs}
    records.append(motion.with_channels(**readings))

# %%
# The first two flights are used for the estimation. The values of the file are the prior.
fit = cs.solve(cs.Problem(model, records[:2], free=list(rough), noise=noise))
print("              file   estimated          true")
for name, value in rough.items():
    print(f"{name:10} {value:7.3f}   {fit[name].value:7.3f} +- {fit[name].std:.3f}   {truth[name]:7.3f}")

# %%
# The third flight was not used. It shows what the estimation improves, and :func:`casid.modes` gives frequency and
# damping of the short period, from which the first gains of a controller follow.
refined = replace(file, derivatives={name: fit[name].value for name in rough})
for label, aircraft in (("file", file), ("estimated", refined)):
    simulated = cs.simulate(cs.aircraft_model(aircraft, axes="longitudinal", outputs=outputs), records[2], start)
    error = simulated.output("q") - records[2]["q"]
    plt.plot(t, simulated.output("q"), label=label)
    print(label, f"r.m.s. error of q {np.sqrt(np.mean(error**2)):.4f} rad/s (noise {noise['q']})")
for name, number in cs.modes(file, V=25.0, rho=1.2, fit=fit).modes["short period"].numbers.items():
    print(f"{name}: {number.value:.3f} +- {number.std:.3f} {number.unit}")
plt.plot(t, records[2]["q"], "k.", markersize=2, label="flight")
plt.xlabel("time [s]")
plt.ylabel("q [rad/s]")
plt.legend()
plt.show()
