"""
Which propeller is damaged?
===========================

A Crazyflie 2.1 hovers and moves a little. In one of its logs 3 mm are cut off a propeller. A normal flight makes the
simulation of this airframe, and the log in question is diagnosed with it. No test stand is needed, and a guess
of the inertia: weight and moments of steady hover determine the thrust of each rotor.

The flights are those of CrazyPAD (Masalimov, Muslimov, Kozlov, Munasypov: Data 2024, 9, 79; MIT licence), averaged to
50 Hz.
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import casid as cs

here = Path("crazypad") if Path("crazypad").is_dir() else Path("docs/examples/crazypad")
normal, cut = ([cs.read_record(here / f"{name}_{i}.csv.gz") for i in (1, 2)] for name in ("normal", "cut"))

# %%
# The simulation to begin with: thrust [N] by the command of a motor, 0 to 65535, after J. Foerster (ETH Zurich 2015).
# The effectiveness of each rotor is known to a fifth.
arms = {"m1": (1, 1, 1), "m2": (-1, 1, -1), "m3": (-1, -1, 1), "m4": (1, -1, -1)}  # x, y and spin
rotors = [
    cs.Rotor(
        name=name,
        position=(0.0325 * x, 0.0325 * y, 0.0),
        spin=spin,
        thrust=(5.48456e-4, 1.032633e-6, 2.130295e-11),
        torque=0.005965,
        lag=0.06,
    )
    for name, (x, y, spin) in arms.items()
]
crazyflie = cs.Aircraft(
    name="Crazyflie 2.1",
    mass=0.032,
    inertia=cs.Inertia(Ixx=2.6e-5, Iyy=2.8e-5, Izz=4.5e-5, Ixz=0.0),
    rotors=cs.Rotors(each=rotors, relative_uncertainty=0.2),
)

# %%
# The normal flight gives the effectiveness of each rotor. How far the next flight of the same airframe may be from it
# is known from other normal logs: 3 %.
before = cs.diagnose(crazyflie, normal[:1], hold_out=normal[1:])
names = list(arms)
healthy = np.array([before.flight[f"effectiveness_{name}"].value for name in names])
of_airframe = [
    cs.Rotor(
        name=one.name,
        position=one.position,
        spin=one.spin,
        thrust=one.thrust,
        torque=one.torque,
        lag=one.lag,
        effectiveness=float(value),
        std=0.03 * float(value),
    )
    for one, value in zip(rotors, healthy, strict=True)
]
airframe = cs.Aircraft(
    name="this airframe",
    mass=crazyflie.mass,
    inertia=crazyflie.inertia,
    rotors=cs.Rotors(each=of_airframe, relative_uncertainty=0.03),
)

# %%
# The log in question.
after = cs.diagnose(airframe, cut[:1], hold_out=cut[1:])
print(after)
assert after.causes[0].target == "m3"

# %%
# Thrust per command against the normal flight. The propeller of M3 is 3 mm shorter on one blade.
change = {
    name: after.flight[f"effectiveness_{name}"].value / value - 1.0 for name, value in zip(names, healthy, strict=True)
}
for cause in after.causes:
    change[cause.target] += cause.value
figure, ax = plt.subplots(figsize=(5, 3), layout="constrained")
ax.bar(names, [100.0 * value for value in change.values()], color=["#999", "#999", "#d95f02", "#999"])
ax.axhline(0.0, color="k", lw=0.8)
ax.set_ylabel("thrust per command [%]")
ax.set_title("Change since the normal flight")
plt.show()
