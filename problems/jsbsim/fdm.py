"""One flight in JSBSim: settle at trim under a simple autopilot, freeze the controls, fly the schedule, log.

Needs the optional package `jsbsim`.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from casid.errors import InputError
from problems.jsbsim.airframe import FT, LBF, RATE_HZ, SLUG, SLUG_FT2, Airframe
from problems.jsbsim.edit import Edit, prepare
from problems.jsbsim.manoeuvres import CONTROLS, SURFACES

SETTLE_S = 300.0
RESETTLE_S = 80.0
LEAD_IN_S = 4.0
_ADAMS_BASHFORTH_3 = 4
# channel -> (JSBSim property, factor to SI); forces and wind-relative velocities are reduced further below
_LOG: dict[str, tuple[str, float]] = {
    "u": ("velocities/u-aero-fps", FT),
    "v": ("velocities/v-aero-fps", FT),
    "w": ("velocities/w-aero-fps", FT),
    "p": ("velocities/p-rad_sec", 1.0),
    "q": ("velocities/q-rad_sec", 1.0),
    "r": ("velocities/r-rad_sec", 1.0),
    "phi": ("attitude/phi-rad", 1.0),
    "theta": ("attitude/theta-rad", 1.0),
    "psi": ("attitude/psi-rad", 1.0),
    "Fx": ("forces/fbx-total-lbs", LBF),
    "Fy": ("forces/fby-total-lbs", LBF),
    "Fz": ("forces/fbz-total-lbs", LBF),
    "pdot": ("accelerations/pdot-rad_sec2", 1.0),
    "qdot": ("accelerations/qdot-rad_sec2", 1.0),
    "rdot": ("accelerations/rdot-rad_sec2", 1.0),
    "thrust": ("forces/fbx-prop-lbs", LBF),
    "altitude": ("position/h-sl-ft", FT),
    "rho": ("atmosphere/rho-slugs_ft3", SLUG / FT**3),
    "mach": ("velocities/mach", 1.0),
    "L_prop": ("moments/l-prop-lbsft", LBF * FT),
    "turb_x": ("atmosphere/turb-north-fps", FT),
    "turb_y": ("atmosphere/turb-east-fps", FT),
    "turb_z": ("atmosphere/turb-down-fps", FT),
    "L": ("moments/l-total-lbsft", LBF * FT),
    "M": ("moments/m-total-lbsft", LBF * FT),
    "N": ("moments/n-total-lbsft", LBF * FT),
    **{f"seen_{surface}": (f"flight/{surface}-aero", 1.0) for surface in SURFACES},
    "M_prop": ("moments/m-prop-lbsft", LBF * FT),
    "N_prop": ("moments/n-prop-lbsft", LBF * FT),
}

# what an effect that depends on the motion may look at, SI
FOLLOWED: Mapping[str, tuple[str, float]] = {
    "V": ("velocities/vt-fps", FT),
    "alpha": ("aero/alpha-rad", 1.0),
    "beta": ("aero/beta-rad", 1.0),
    "p": ("velocities/p-rad_sec", 1.0),
    "q": ("velocities/q-rad_sec", 1.0),
    "r": ("velocities/r-rad_sec", 1.0),
    "ay": ("accelerations/a-pilot-y-ft_sec2", FT),
}
Follower = Callable[[float, Mapping[str, float]], Mapping[str, float]]


@dataclass(frozen=True, eq=False, kw_only=True)
class Log:
    """A flight at RATE_HZ, without instruments, about the actual centre of gravity.

    t          (N,) [s], 0 at the start of the record
    channels   name -> (N,) in SI: u v w relative to the air, p q r, phi theta psi, ax ay az specific force,
               pdot qdot rdot, thrust (sum over the engines along body x), altitude, rho, mach, moments L M N and
               their share L_prop M_prop N_prop of the engines, turbulence turb_x y z north east down, the
               commanded delta_e delta_a delta_r and what the air sees of them, seen_delta_e ...
    mass       [kg];  inertia (3, 3) tensor [kg m2];  cg (3,) [m] in JSBSim's structural axes (x aft, z up)
    reference  area [m2], span [m], chord [m];  gravity [m/s2] at the flight's altitude
    engine_y   [m] of each engine;  thrust_line_z [m] from the centre of gravity, down positive
    """

    t: np.ndarray
    channels: Mapping[str, np.ndarray]
    mass: float
    inertia: np.ndarray
    cg: np.ndarray
    area: float
    span: float
    chord: float
    gravity: float
    engine_y: tuple[float, ...]
    thrust_line_z: float


def simulate(
    frame: Airframe,
    edit: Edit,
    controls: Mapping[str, np.ndarray],
    schedule: Mapping[str, np.ndarray],
    follower: Follower | None = None,
    steady: Mapping[str, float] | None = None,
) -> Log:
    """Fly `frame`, changed by `edit`, through one record.

    controls   deviation from trim per control, (N,) at RATE_HZ: surfaces [rad], throttle [1]
    schedule   JSBSim property -> (N,) values over the record, the first from the lead-in on, NaN: not written.
               "throttle[i]" is a factor on the throttle of engine i, "wind[x]" a wind [m/s] along x, y, z of the trim
    follower   after every sample, what it makes of (time [s], `FOLLOWED` signals) is written to JSBSim's properties
    steady     what `steady_flight` found for the unchanged airframe: the autopilot begins there and needs less time
    Raises InputError when the optional package jsbsim is missing or the aircraft does not settle at trim.
    """
    with tempfile.TemporaryDirectory(prefix="casid-jsbsim-") as folder:
        fdm = _load(frame, edit, Path(folder), steady)
        trim = _settle(fdm, frame, steady)
        return _record(fdm, frame, trim, controls, schedule, follower)


@lru_cache
def steady_flight(model: str, find: Callable[[str], Airframe]) -> Mapping[str, float]:
    """Controls and pitch angle theta [rad] of level flight of an unchanged airframe, found by its name."""
    frame = find(model)
    with tempfile.TemporaryDirectory(prefix="casid-jsbsim-") as folder:
        fdm = _load(frame, Edit(), Path(folder), None)
        return _settle(fdm, frame, None) | {"theta": fdm["attitude/theta-rad"]}


def _load(frame: Airframe, edit: Edit, folder: Path, steady: Mapping[str, float] | None) -> Any:
    try:
        import jsbsim
    except ImportError as error:
        raise InputError(
            "flying a JSBSim aircraft needs the extra jsbsim; install it: pip install 'casid[jsbsim]'"
        ) from error
    prepare(frame, edit, Path(jsbsim.get_default_root_dir()), folder)
    jsbsim.set_logger(jsbsim.DefaultLogger(jsbsim.LogLevel.ERROR))
    fdm = jsbsim.FGFDMExec(str(folder))
    fdm.set_debug_level(0)
    fdm.load_planet(str(folder / "planet.xml"), False)
    fdm.set_dt(1.0 / RATE_HZ)  # before loading: the servos take their step from it
    fdm.load_model(frame.model)
    fdm["ic/h-sl-ft"] = frame.altitude_m / FT
    fdm["ic/vt-fps"] = frame.speed_mps / FT
    fdm["ic/alpha-deg"] = 1.0 if steady is None else np.degrees(steady["theta"])
    fdm["ic/gamma-deg"] = 0.0
    fdm["ic/psi-true-deg"] = 45.0
    fdm["simulation/gravity-model"] = 0
    fdm.run_ic()
    fdm["gear/gear-cmd-norm"] = 0.0
    fdm["gear/gear-pos-norm"] = 0.0
    for name, value in frame.controls.items():
        fdm[name] = value
    for engine in range(frame.engines):
        for name in ("mixture", "advance"):
            fdm[f"fcs/{name}-cmd-norm[{engine}]"] = frame.controls.get(f"fcs/{name}-cmd-norm", 1.0)
    fdm["propulsion/set-running"] = -1
    fdm["propulsion/cutoff_cmd"] = 0
    fdm["propulsion/fuel_freeze"] = 1
    if frame.propeller and not edit.propeller_moments:
        for engine in range(frame.engines):
            fdm[f"propulsion/engine[{engine}]/propeller-sense"] = 0.0
    for name in ("rate/rotational", "position/rotational", "rate/translational", "position/translational"):
        fdm[f"simulation/integrator/{name}"] = _ADAMS_BASHFORTH_3
    return fdm


def _settle(fdm: Any, frame: Airframe, steady: Mapping[str, float] | None) -> dict[str, float]:
    """Controls that hold level flight at the airframe's trim point: the mean over the last seconds of an autopilot."""
    dt = 1.0 / RATE_HZ
    steps, last = int((SETTLE_S if steady is None else RESETTLE_S) * RATE_HZ), int(5.0 * RATE_HZ)
    total = dict.fromkeys(CONTROLS, 0.0)
    pitch = bank = slip = 0.0
    power = 0.7
    if steady is not None:
        pitch, bank = steady["theta"] - steady["delta_e"] / 0.8, -steady["delta_a"]
        slip, power = -steady["delta_r"], steady["throttle"]
    for step in range(steps):
        speed = FT * fdm["velocities/vt-fps"]
        gamma = fdm["flight-path/gamma-rad"]
        wanted = _within(-0.04, 0.001 * (frame.altitude_m - FT * fdm["position/h-sl-ft"]), 0.04)
        pitch += 0.06 * (wanted - gamma) * dt
        tilt = fdm["attitude/theta-rad"] - pitch - 0.8 * (wanted - gamma)
        slow = (frame.speed_mps - speed) / frame.speed_mps
        bank += 0.05 * fdm["attitude/phi-rad"] * dt
        slip += 0.2 * fdm["aero/beta-rad"] * dt
        power = _within(0.0, power + 0.08 * slow * dt, 1.0)
        now = {
            "delta_e": 0.8 * tilt + 0.6 * fdm["velocities/q-rad_sec"],
            "delta_a": -0.3 * fdm["attitude/phi-rad"] - bank - 0.2 * fdm["velocities/p-rad_sec"],
            "delta_r": -slip + 0.4 * fdm["velocities/r-rad_sec"],
            "throttle": _within(0.0, power + 5.0 * slow, 1.0),
        }
        _control(fdm, frame, now, now)
        fdm["flight/reynolds-number"] = fdm["aero/Re"]
        fdm.run()
        if step >= steps - last:
            total = {name: total[name] + now[name] / last for name in total}
    if abs(slow) > 0.01 or abs(gamma) > 0.005 or abs(fdm["attitude/phi-rad"]) > 0.02:
        raise InputError(
            f"JSBSim airframe '{frame.name}' does not settle at {frame.speed_mps} m/s, {frame.altitude_m} m: "
            f"speed {speed:.1f} m/s, flight path {gamma:.4f} rad; choose another trim point"
        )
    return total


def _within(low: float, value: float, high: float) -> float:
    return min(max(value, low), high)


def _control(fdm: Any, frame: Airframe, trim: Mapping[str, float], now: Mapping[str, float]) -> None:
    for surface in SURFACES:
        fdm[f"flight/{surface}-trim"] = trim[surface]
        fdm[f"flight/{surface}-command"] = now[surface]
    for engine in range(frame.engines):
        fdm[f"fcs/throttle-cmd-norm[{engine}]"] = now["throttle"]


def _record(
    fdm: Any,
    frame: Airframe,
    trim: Mapping[str, float],
    controls: Mapping[str, np.ndarray],
    schedule: Mapping[str, np.ndarray],
    follower: Follower | None,
) -> Log:
    samples, lead = len(controls["delta_e"]), int(LEAD_IN_S * RATE_HZ)
    rows = np.empty((samples, len(_LOG)))
    properties = [name for name, _ in _LOG.values()]
    factors = np.array([factor for _, factor in _LOG.values()])
    moved = {name: trim[name] + controls[name] for name in CONTROLS}
    heading = fdm["attitude/psi-rad"]
    for step in range(-lead, samples):
        k = max(step, 0)
        now = dict(trim) if step < 0 else {name: float(moved[name][k]) for name in CONTROLS}
        _control(fdm, frame, trim, now)
        if step == -lead or step > 0:
            _apply(fdm, schedule, k, now["throttle"], heading)
        fdm.run()
        if step >= 0:
            rows[k] = [fdm[name] for name in properties]
            if follower is not None:
                for name, value in follower(k / RATE_HZ, {n: f * fdm[p] for n, (p, f) in FOLLOWED.items()}).items():
                    fdm[name] = value
    if not np.isfinite(rows).all():
        raise InputError(f"JSBSim airframe '{frame.name}' left the air data's range; choose smaller inputs")
    return _log(fdm, frame, dict(zip(_LOG, (rows * factors).T, strict=True)), {s: moved[s] for s in SURFACES})


def _apply(fdm: Any, schedule: Mapping[str, np.ndarray], k: int, throttle: float, heading: float) -> None:
    """Write sample k of the schedule; NaN leaves a property alone."""
    cos_psi, sin_psi = np.cos(heading), np.sin(heading)
    directions = {"x": (cos_psi, sin_psi, 0.0), "y": (-sin_psi, cos_psi, 0.0), "z": (0.0, 0.0, 1.0)}
    for name, values in schedule.items():
        value = float(values[k])
        if np.isnan(value):
            continue
        if name.startswith("throttle["):
            fdm[f"fcs/throttle-cmd-norm{name[8:]}"] = throttle * value
        elif name.startswith("wind["):
            for compass, part in zip(("north", "east", "down"), directions[name[5]], strict=True):
                fdm[f"atmosphere/wind-{compass}-fps"] = value * part / FT
        else:
            fdm[name] = value


def _log(fdm: Any, frame: Airframe, channels: dict[str, np.ndarray], surfaces: Mapping[str, np.ndarray]) -> Log:
    mass = SLUG * fdm["inertia/mass-slugs"]
    for axis in "xyz":
        channels[f"a{axis}"] = channels.pop(f"F{axis}") / mass
    # the property is the tensor's element, so our product of inertia Ixz is its negative
    xx, yy, zz, xz, xy, yz = (fdm[f"inertia/i{pair}-slugs_ft2"] for pair in ("xx", "yy", "zz", "xz", "xy", "yz"))
    lateral = [FT / 12.0 * fdm[f"propulsion/engine[{i}]/y-reference-position"] for i in range(frame.engines)]
    return Log(
        t=np.arange(len(channels["p"])) / RATE_HZ,
        channels={**channels, **surfaces},
        mass=mass,
        inertia=SLUG_FT2 * np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]),
        cg=FT / 12.0 * np.array([fdm[f"inertia/cg-{axis}-in"] for axis in "xyz"]),
        area=FT**2 * fdm["metrics/Sw-sqft"],
        span=FT * fdm["metrics/bw-ft"],
        chord=FT * fdm["metrics/cbarw-ft"],
        gravity=FT * fdm["accelerations/gravity-ft_sec2"],
        engine_y=tuple(lateral),
        thrust_line_z=float(np.mean(channels["M_prop"] / channels["thrust"])),
    )
