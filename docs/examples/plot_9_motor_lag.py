"""
The motor lag of a simulator
============================

The motors of a simulated quadrotor answer within 5 ms; those of the real one need 72 ms, fourteen times as long. The
simulation looks right in hover, and its controller fails in flight. One flight with a few quick moves tells.

The flight is made here by the laws of Newton and Euler, without casid (``problems/rotors/newton.py``).
"""

import matplotlib.pyplot as plt
import numpy as np

import casid as cs
from problems.rotors.newton import Craft, G, flight, quad

mass, arm, inertia = 0.5, 0.12, np.diag([3.5e-3, 3.6e-3, 6.5e-3])
places, spins = quad(arm)
per_square = 5e-6  # N s2, thrust over the square of a speed

# %%
# The truth: motors with a time constant of 72 ms.
slow = Craft(
    places=places,
    spins=spins,
    mass=lambda t: mass,
    inertia=inertia,
    thrust=lambda t, speed: per_square * speed**2,
    input_for=lambda thrust: np.sqrt(np.maximum(thrust, 0.0) / per_square),
    torque=0.016,
    lag=0.072,
)
flown = flight(slow, seed=2, size=1.2, gains=(40.0, 11.0))
record = cs.Record.from_arrays(
    name="flight", t=flown.pop("t"), channels=flown, units={"p": "rad/s", "q": "rad/s", "r": "rad/s"}
)

# %%
# The simulation: everything as in the truth, but for the lag.
rotors = [
    cs.Rotor(
        name=f"m{i}",
        position=tuple(map(float, place)),
        spin=float(spin),
        thrust=(0.0, 0.0, per_square),
        speed=True,
        torque=0.016,
        lag=0.005,
        std=0.03,
    )
    for i, (place, spin) in enumerate(zip(places, spins, strict=True), start=1)
]
simulation = cs.Aircraft(
    name="simulation",
    mass=mass,
    gravity=G,
    inertia=cs.Inertia(Ixx=3.5e-3, Iyy=3.6e-3, Izz=6.5e-3, Ixz=0.0),
    rotors=cs.Rotors(each=rotors),
)
found = cs.diagnose(simulation, [record])
print(found)
lag = 0.005 + found.causes[0].value
assert found.causes[0].kind == "rotor_lag" and 0.06 < lag < 0.085

# %%
# The answer of a rotor to a step of its command, as simulated and as found.
t = np.linspace(0.0, 0.3, 301)
figure, ax = plt.subplots(figsize=(6, 3), layout="constrained")
for constant, label, style in ((0.005, "simulation", "--"), (lag, "by the records", "-"), (0.072, "true", "k:")):
    ax.plot(1e3 * t, 1.0 - np.exp(-t / constant), style, label=f"{label}: {1e3 * constant:.0f} ms")
ax.set_xlabel("time [ms]")
ax.set_ylabel("part of the commanded speed")
ax.legend()
plt.show()
