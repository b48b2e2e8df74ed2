"""Does `Aircraft.from_jsbsim` compute what JSBSim computes? Aerodynamic coefficients, rates of the state, trajectories.

JSBSim flies the stock file without control system, engines and systems, so that surfaces stay where they are put, over
an earth that does not turn and is so large that it is flat, as casid has it. Needs the optional package jsbsim.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from types import SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np

from casid.errors import InputError
from casid.formats.jsbsim.aerodynamics import JsbsimAerodynamics
from casid.formats.jsbsim.source import load
from casid.model.aerodynamics import FURTHER
from casid.model.aircraft import Aircraft
from casid.model.dynamics import aircraft_model
from casid.model.simulate import simulate
from casid.model.terms import VARIABLES
from casid.records.record import Record
from casid.signals import FOOT, POUND_FORCE, SLUG, SURFACES

COEFFICIENTS = ("CL", "CD", "CY", "Cl", "Cm", "Cn")
_OF_THE_AIR = ("velocities/mach", "aero/Re")  # its temperature, which no record has
LEAST = 1e-3  # of a coefficient, below which its error counts as if it were that large
_GONE = ("flight_control", "autopilot", "system", "input", "output", "external_reactions", "buoyant_forces")
_KEPT_OF_PROPULSION = ("tank",)
_EARTH = """<planet name="flat">
  <equatorial_radius unit="M">6.371e11</equatorial_radius><polar_radius unit="M">6.371e11</polar_radius>
  <rotation_rate unit="RAD/SEC">0.0</rotation_rate><GM unit="M3/SEC2">3.9804840291265e+24</GM><J2>0.0</J2>
</planet>"""
_RATE_PROPERTIES = (
    *((f"accelerations/{axis}dot-ft_sec2", FOOT) for axis in "uvw"),
    *((f"accelerations/{axis}dot-rad_sec2", 1.0) for axis in "pqr"),
)


def file_of(name: str) -> Path:
    """The XML of a stock aircraft. Raises InputError when the package is missing."""
    try:
        import jsbsim
    except ImportError:
        raise InputError("this needs the extra jsbsim; install it: pip install 'casid[jsbsim]'") from None
    return Path(jsbsim.get_default_root_dir()) / "aircraft" / name / f"{name}.xml"


@dataclass(frozen=True, eq=False)
class Rig:
    """A stock aircraft in JSBSim, bare, and as casid reads it; `held` properties are symbols, set to JSBSim's."""

    name: str
    fdm: Any
    aircraft: Aircraft
    held: tuple[str, ...]

    @property
    def own(self) -> JsbsimAerodynamics:
        own = self.aircraft.aerodynamics
        assert isinstance(own, JsbsimAerodynamics)
        return own


def rig(name: str) -> Rig:
    """Raises InputError when casid cannot read the file, or JSBSim not fly what is left of it."""
    import jsbsim

    aircraft = Aircraft.from_jsbsim(file_of(name))
    own = aircraft.aerodynamics
    assert isinstance(own, JsbsimAerodynamics)
    root = load(file_of(name))
    for section in list(root):
        if section.tag in _GONE:
            root.remove(section)
        elif section.tag == "propulsion":
            for node in [n for n in section if n.tag not in _KEPT_OF_PROPULSION]:
                section.remove(node)
        section.attrib.pop("file", None)
    if root.find("ground_reactions") is None or not len(root.find("ground_reactions") or ()):
        raise InputError("<ground_reactions> is in a file of its own, without which JSBSim does not load it")
    jsbsim.set_logger(jsbsim.DefaultLogger(jsbsim.LogLevel.FATAL))
    with TemporaryDirectory(prefix="casid-jsbsim-") as folder:
        target = Path(folder) / "aircraft" / name
        target.mkdir(parents=True)
        ET.ElementTree(root).write(target / f"{name}.xml")
        (Path(folder) / "planet.xml").write_text(_EARTH)
        fdm = jsbsim.FGFDMExec(folder)
        fdm.set_debug_level(0)
        fdm.load_planet(str(Path(folder) / "planet.xml"), False)
        held = own.taken_as_held
        for prop, value in {**held, **dict(own.held), **dict.fromkeys(_surfaces(0.0, 0.0, 0.0), 0.0)}.items():
            fdm[prop] = value
        if not fdm.load_model(name):
            raise InputError("JSBSim does not load it without its control system and engines")
    fdm["simulation/gravity-model"] = 0
    return Rig(name=name, fdm=fdm, aircraft=aircraft, held=tuple(held))


def _surfaces(delta_e: float, delta_a: float, delta_r: float) -> dict[str, float]:
    """Properties that surfaces are put to."""
    elevator = {"fcs/elevator-pos-rad": delta_e, "fcs/mag-elevator-pos-rad": abs(delta_e)}
    left = dict.fromkeys(("fcs/left-aileron-pos-rad", "fcs/effective-aileron-pos", "fcs/aileron-pos-rad"), delta_a)
    return {**elevator, **left, "fcs/right-aileron-pos-rad": -delta_a, "fcs/rudder-pos-rad": delta_r}


def put(one: Rig, rng: np.random.Generator) -> dict[str, float]:
    """Bring JSBSim into a random state with random surfaces; returns the surfaces."""
    fdm = one.fdm
    speed, alpha, beta = rng.uniform(150.0, 600.0), rng.uniform(-0.15, 0.3), rng.uniform(-0.2, 0.2)
    drawn = {
        "h-sl-ft": rng.uniform(6000.0, 30000.0),
        "phi-rad": rng.uniform(-0.8, 0.8),
        "theta-rad": rng.uniform(-0.5, 0.5),
        "psi-true-rad": 0.0,
        "u-fps": speed * np.cos(alpha) * np.cos(beta),
        "v-fps": speed * np.sin(beta),
        "w-fps": speed * np.sin(alpha) * np.cos(beta),
        "p-rad_sec": rng.uniform(-0.5, 0.5),
        "q-rad_sec": rng.uniform(-0.3, 0.3),
        "r-rad_sec": rng.uniform(-0.3, 0.3),
    }
    fdm.reset_to_initial_conditions(0)
    for name, value in drawn.items():
        fdm[f"ic/{name}"] = value
    fdm.run_ic()
    surfaces: dict[str, float] = dict(zip(SURFACES, rng.uniform(-0.3, 0.3, 3).tolist(), strict=True))
    for name, value in _surfaces(**surfaces).items():
        fdm[name] = value
    for name in one.held:
        fdm[name] = rng.uniform(0.0, 1.0)
    for name, value in one.own.held:
        fdm[name] = value
    _put_static(one, surfaces)
    if abs(fdm["velocities/vt-fps"] - speed) > 1e-6 * speed:
        raise InputError(f"JSBSim does not take the speed of {speed:.1f} ft/s: {fdm['velocities/vt-fps']:.1f} ft/s")
    fdm.suspend_integration()
    for _ in range(6):  # what depends on the rates of the flow angles settles
        fdm.run()
    fdm.resume_integration()
    return surfaces


def _put_static(one: Rig, surfaces: Mapping[str, float]) -> None:
    """What components of the control system, which is gone, would make of the surfaces."""
    s = _symbols()
    for name, value in one.own.coefficients(s)[1].values.items():
        if name.startswith("fcs/") and name not in one.held and name not in _surfaces(0.0, 0.0, 0.0):
            wanted = [getattr(s, surface) for surface in surfaces]
            at = ca.Function("static", wanted, [ca.SX(value)])
            one.fdm[name] = float(at(*surfaces.values()))


def _symbols() -> SimpleNamespace:
    return SimpleNamespace(**{name: ca.SX.sym(name) for name in (*VARIABLES, *FURTHER)})


@dataclass(frozen=True, kw_only=True)
class Agreement:
    """Largest relative differences at random states; what of a coefficient or rate is small counts as `LEAST` of it.

    coefficients   with the rates of the flow angles, Mach and Reynolds number as JSBSim has them
    rates          of the model of casid, from state and surfaces alone; over the largest rate of its kind
    """

    states: int
    coefficients: float
    rates: float


def compare(one: Rig, states: int, seed: int) -> Agreement:
    """At random states, with JSBSim's own values of what is held."""
    rng = np.random.default_rng(seed)
    s, held = _symbols(), {name: ca.SX.sym(name) for name in (*one.held, *_OF_THE_AIR)}
    found = replace(one.own, held=(*one.own.held, *held.items())).coefficients(s)[0]
    given = ca.vertcat(*held.values())
    result = ca.vertcat(*(found[c] for c in COEFFICIENTS))
    look_up = ca.Function("coefficients", [ca.vertcat(*vars(s).values()), given], [result])
    rates_of = _model_rates(one)
    worst = {"coefficients": 0.0, "rates": 0.0}
    for _ in range(states):
        surfaces = put(one, rng)
        fdm = one.fdm
        values = _quantities(fdm) | surfaces
        ours = look_up([values[name] for name in vars(s)], [fdm[name] for name in held]).full()[:, 0]
        worst["coefficients"] = max(worst["coefficients"], _apart(ours, _coefficients(fdm), LEAST))
        theirs, ours = np.array([factor * fdm[name] for name, factor in _RATE_PROPERTIES]), rates_of(surfaces)
        for part in (slice(0, 3), slice(3, 6)):
            worst["rates"] = max(worst["rates"], _apart(ours[part], theirs[part], float(np.max(np.abs(theirs[part])))))
    return Agreement(states=states, **worst)


def _apart(ours: np.ndarray, theirs: np.ndarray, least: float) -> float:
    return float(np.max(np.abs(ours - theirs) / np.maximum(np.abs(theirs), least)))


def _quantities(fdm: Any) -> dict[str, float]:
    V, b, c = fdm["velocities/vt-fps"], fdm["metrics/bw-ft"], fdm["metrics/cbarw-ft"]
    return {
        "alpha": fdm["aero/alpha-rad"],
        "beta": fdm["aero/beta-rad"],
        **{x: fdm[f"velocities/{x}-aero-rad_sec"] * (c if x == "q" else b) / (2.0 * V) for x in "pqr"},
        "alphadot": fdm["aero/alphadot-rad_sec"] * c / (2.0 * V),
        "betadot": fdm["aero/betadot-rad_sec"] * b / (2.0 * V),
        "mach": fdm["velocities/mach"],
        "airspeed": V * FOOT,
        "qbar": fdm["aero/qbar-psf"] * POUND_FORCE / FOOT**2,
        "rho": fdm["atmosphere/rho-slugs_ft3"] * SLUG / FOOT**3,
        **dict.fromkeys(("thrust", "Tc", "V"), 0.0),
    }


def _coefficients(fdm: Any) -> np.ndarray:
    qS, b, c = fdm["aero/qbar-psf"] * fdm["metrics/Sw-sqft"], fdm["metrics/bw-ft"], fdm["metrics/cbarw-ft"]
    X, Y, Z = (fdm[f"forces/fb{axis}-aero-lbs"] / qS for axis in "xyz")
    L, M, N = (fdm[f"moments/{axis}-aero-lbsft"] / qS for axis in "lmn")
    sin_a, cos_a = np.sin(fdm["aero/alpha-rad"]), np.cos(fdm["aero/alpha-rad"])
    return np.array([X * sin_a - Z * cos_a, -X * cos_a - Z * sin_a, Y, L / b, M / c, N / b])


def _state(fdm: Any) -> np.ndarray:
    """(8,) as JSBSim has it."""
    velocity = [FOOT * fdm[f"velocities/{axis}-fps"] for axis in "uvw"]
    rates = [fdm[f"velocities/{axis}-rad_sec"] for axis in "pqr"]
    return np.array([*velocity, *rates, fdm["attitude/phi-rad"], fdm["attitude/theta-rad"]])


def _model_rates(one: Rig) -> Callable[[Mapping[str, float]], np.ndarray]:
    """surfaces -> (6,) rates of u v w p q r of the aircraft's model, at JSBSim's present state."""
    held = {name: ca.SX.sym(name) for name in (*one.held, *_OF_THE_AIR)}
    own = replace(one.own, held=(*one.own.held, *held.items()))
    model = aircraft_model(replace(one.aircraft, aerodynamics=own), effects=(), outputs=("q",))
    nothing = np.zeros(len(model.disturbances))
    f = ca.Function("f", [model.x, model.u, model.p, model.w, ca.vertcat(*held.values())], [model.f])

    def rates(surfaces: Mapping[str, float]) -> np.ndarray:
        fdm, x = one.fdm, _state(one.fdm)
        inputs = {**surfaces, "thrust": 0.0, "rho": _quantities(fdm)["rho"]}
        at = [inputs[name] for name in model.inputs]
        found = f(x, at, model.nominal_vector(), nothing, [fdm[name] for name in held]).full()[:6, 0]
        heavier = FOOT * fdm["accelerations/gravity-ft_sec2"] - one.aircraft.gravity
        phi, theta = x[6:]
        down = [-np.sin(theta), np.cos(theta) * np.sin(phi), np.cos(theta) * np.cos(phi)]
        return found + heavier * np.array([*down, 0.0, 0.0, 0.0])

    return rates


FLOWN = {"h-sl-ft": 10000.0, "vt-fps": 400.0, "alpha-rad": 0.05, "beta-rad": 0.01, "theta-rad": 0.03, "phi-rad": 0.05}
_ADAMS_BASHFORTH_3 = 4


def gliding(one: Rig, rate_hz: int, seconds: float, size: float = 0.01) -> tuple[np.ndarray, np.ndarray]:
    """(seconds + 1, 8) states once a second, of JSBSim and of casid, along the same slow surfaces, engines off."""
    fdm, t = one.fdm, np.arange(round(seconds * rate_hz) + 1) / rate_hz
    fdm.set_dt(1.0 / rate_hz)
    for name, value in FLOWN.items():
        fdm[f"ic/{name}"] = value
    for name in ("p", "q", "r"):
        fdm[f"ic/{name}-rad_sec"] = 0.0
    for name in ("rate/rotational", "position/rotational", "rate/translational", "position/translational"):
        fdm[f"simulation/integrator/{name}"] = _ADAMS_BASHFORTH_3
    waves = zip(SURFACES, (1.1, 1.7, 2.3), strict=True)
    surfaces = {name: size * np.sin(rate * t) for name, rate in waves}
    for name, value in {**one.own.taken_as_held, **dict(one.own.held), **_surfaces(0.0, 0.0, 0.0)}.items():
        fdm[name] = value
    fdm.run_ic()
    for name, value in {**one.own.taken_as_held, **dict(one.own.held)}.items():
        fdm[name] = value
    rows, rho = [_state(fdm)], [_quantities(fdm)["rho"]]
    for k in range(1, len(t)):
        for name, value in _surfaces(**{name: float(series[k]) for name, series in surfaces.items()}).items():
            fdm[name] = value
        fdm.run()
        rows.append(_state(fdm))
        rho.append(_quantities(fdm)["rho"])
    gravity = FOOT * fdm["accelerations/gravity-ft_sec2"]
    model = aircraft_model(replace(one.aircraft, gravity=gravity), effects=(), outputs=("q",))
    channels = {**surfaces, "thrust": np.zeros(len(t)), "rho": np.array(rho)}
    ours = simulate(model, Record(name="gliding", t=t, channels=channels), rows[0]).states
    return np.array(rows)[::rate_hz], ours[::rate_hz]
