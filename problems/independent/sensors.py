"""Instruments: what they read where they stand, sampled and with noise."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from problems.independent.motion import POSITION, ROTATION, angles_of


@dataclass(frozen=True, kw_only=True)
class Instruments:
    """Errors of the instruments; none by default.

    accelerometer  its place [m] from the reference point;  delay_s, scale, bias  by channel
    """

    accelerometer: tuple[float, float, float] = (0.0, 0.0, 0.0)
    delay_s: Mapping[str, float] = field(default_factory=dict)
    scale: Mapping[str, float] = field(default_factory=dict)
    bias: Mapping[str, float] = field(default_factory=dict)


def readings(log: Mapping[str, np.ndarray], instruments: Instruments, cg: np.ndarray) -> dict[str, np.ndarray]:
    """Channel -> (N,) of one record, at the steps of the simulation. `log` has the columns of that record, `cg` (3,) is
    measured from the reference point. Vanes are corrected to the true centre of gravity."""
    omega, turning = log["x"][:, ROTATION], log["turning"]
    arm = np.asarray(instruments.accelerometer) - cg
    force = log["force"] + np.cross(turning, arm) + np.cross(omega, np.cross(omega, arm))
    phi, theta, psi = angles_of(log["x"][:, 6:10].T)
    read = {
        **{name: log[name] for name in ("V", "alpha", "beta", "thrust", "rho")},
        **dict(zip(("p", "q", "r"), omega.T, strict=True)),
        "phi": phi,
        "theta": theta,
        "psi": np.unwrap(psi),
        **dict(zip(("ax", "ay", "az"), force.T, strict=True)),
        **dict(zip(("pdot", "qdot", "rdot"), turning.T, strict=True)),
        "altitude": -log["x"][:, POSITION][:, 2],
    }
    return read


def recorded(
    read: Mapping[str, np.ndarray],
    t: np.ndarray,
    every: int,
    noise: Mapping[str, float],
    instruments: Instruments,
    rng: np.random.Generator,
) -> dict[str, np.ndarray]:
    """Channel -> samples with delay, scale error, bias and noise. A channel without noise is not recorded, except the
    density, which is exact."""
    samples = {"t": np.round(t[::every], 6), "rho": read["rho"][::every]}
    for name, sigma in noise.items():
        late = np.interp(t - instruments.delay_s.get(name, 0.0), t, read[name])
        exact = (1.0 + instruments.scale.get(name, 0.0)) * late[::every] + instruments.bias.get(name, 0.0)
        spread = sigma * float(np.mean(exact)) if name == "thrust" else sigma
        samples[name] = exact + spread * rng.standard_normal(len(exact))
    return samples
