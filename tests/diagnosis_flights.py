"""Do 328 flights with a hidden effect, for the tests of the diagnosis: flown here, measured with noise, sealed."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from casid.diagnosis.comparisons import Gate
from casid.diagnosis.criteria import Criteria
from casid.diagnosis.engine.trial import Gain, Trial
from casid.diagnosis.evidence.screening import Candidate
from casid.diagnosis.flight.hypothesis import Attached, disturbance_series, readings
from casid.diagnosis.kinematics.check import KinematicCheck
from casid.model.aircraft import Aircraft
from casid.model.dynamics import aircraft_model
from casid.model.operators import TURNING, turned
from casid.model.simulate import simulate
from casid.model.trim import trim
from casid.records.record import Record
from problems.do328 import STABLE, THRUST, V_TRIM, do328

DEG = np.pi / 180.0
NOISE = {
    "V": 0.3,
    "alpha": 0.15 * DEG,
    "beta": 0.15 * DEG,
    "p": 0.05 * DEG,
    "q": 0.05 * DEG,
    "r": 0.05 * DEG,
    "phi": 0.05 * DEG,
    "theta": 0.05 * DEG,
    "ax": 0.05,
    "ay": 0.05,
    "az": 0.08,
}
SURFACE_NOISE = 0.03 * DEG
_PICARD, _AIR = 4, ("wind_x", "wind_y", "wind_z")
_SIGNS = (1.0, -1.0, 0.8, -0.9)


def at_least(gate: str, value: float, threshold: float, criterion: str = "", or_else: Iterable[Gate] = ()) -> Gate:
    """Return a gate that passes if the value reaches the threshold."""
    return Gate(gate=gate, value=value, threshold=threshold, criterion=criterion, or_else=tuple(or_else))


def at_most(gate: str, value: float, threshold: float) -> Gate:
    """Return a gate that passes if the value does not exceed the threshold."""
    return Gate(gate=gate, value=value, threshold=threshold, least=False)


def one_round() -> Criteria:
    """Criteria by which a diagnosis fits the likeliest cause of each ranking once: for what does not hang on names."""
    numerics = Criteria().numerics
    naming = replace(numerics.naming, trials=1, few=1)
    return Criteria(numerics=replace(numerics, naming=naming))


def rough_file() -> Aircraft:
    """An aircraft file whose moments are 30 % off: the start of every estimation here."""
    return do328({name: 0.7 * v if name[:2] in ("Cl", "Cm", "Cn") else v for name, v in STABLE.items()})


def multistep(t: np.ndarray, start: float, pattern: Sequence[tuple[float, float]], unit: float) -> np.ndarray:
    """Steps of (length in units, sign), with edges rounded over nine samples as an actuator rounds them."""
    series, at = np.zeros_like(t), start
    for length, sign in pattern:
        series += sign * ((t >= at) & (t < at + length * unit))
        at += length * unit
    window = np.hanning(9)[1:-1]
    return np.convolve(np.pad(series, 3, "edge"), window / window.sum(), "valid")


_3211 = ((3, 1), (2, -1), (1, 1), (1, -1))
_DOUBLET = ((1, 1), (1, -1))


def flights(
    hidden: Sequence[Attached] = (),
    seed: int = 0,
    *,
    count: int = 3,
    duration_s: float = 20.0,
    rate_hz: float = 25.0,
    disturbance: Mapping[str, np.ndarray] | None = None,
    noise: Mapping[str, float] = NOISE,
    surface_noise: float = SURFACE_NOISE,
    size: float = 1.0,
    hold: str = "linear",
) -> list[Record]:
    """`count` records m1, m2, ... with the hidden effects and any further `disturbance` flown, white noise added;
    `size` scales the manoeuvres. How inputs run between samples, `hold`, is not in the records.

    The recorded surfaces are what was commanded: an actuator effect acts between them and the aircraft.
    """
    aircraft = do328()
    level = trim(aircraft, V=V_TRIM, thrust=THRUST)
    symbolic = [a.effect for a in hidden if a.effect.change is not None]
    model = aircraft_model(aircraft, effects=symbolic)
    values = {a.name: a.values["value"] for a in hidden if a.effect.change is not None}
    rng, t = np.random.default_rng(seed), np.arange(0.0, duration_s, 1.0 / rate_hz)
    records = []
    for i in range(count):
        name, sign = f"m{i + 1}", size * _SIGNS[i % 4]
        pitch = 0.035 * multistep(t, 1.0 + i, _3211, 0.5) + 0.04 * multistep(t, 15.0, _DOUBLET, 0.8)
        channels = {
            "delta_e": level.delta_e + sign * pitch,
            "delta_a": sign * 0.04 * multistep(t, 5.0 + i, _3211, 0.4) - 0.05 * multistep(t, 16.5, _DOUBLET, 0.7),
            "delta_r": sign * 0.05 * multistep(t, 9.0 + i, _3211, 0.5) + 0.04 * multistep(t, 3.0, _DOUBLET, 0.8),
            "thrust": THRUST + sign * 2e3 * multistep(t, 8.0, _DOUBLET, 3.0),
            "rho": np.full(len(t), level.rho),
        }
        commanded = Record(name=name, t=t, channels=channels, hold=hold)
        known = {key: series[:, None] for key, series in channels.items()}
        for _ in range(_PICARD if any(a.effect.enters in _AIR for a in hidden) else 1):
            W = disturbance_series(hidden, [name], t[:, None], known, model.disturbances)[:, 0]
            acting = {station: W[:, j] for j, station in enumerate(model.disturbances)}
            for station, series in (disturbance or {}).items():
                acting[station] = acting[station] + series
            flown = simulate(model, commanded, level.state, values, acting, substeps=2)
            turning = [flown.outputs[:, model.outputs.index(key)] for key in TURNING]
            attitude = {"phi": turning[0], "theta": turning[1], "turned": turned(t, *turning)}
            known |= {key: series[:, None] for key, series in attitude.items()}  # wind keeps its direction
        read = readings(hidden, [name], t[:, None], flown.outputs[:, None], model.outputs, known)[:, 0]
        measured = {o: read[:, model.outputs.index(o)] + rng.normal(0.0, s, len(t)) for o, s in noise.items()}
        surfaces = {s: channels[s] + rng.normal(0.0, surface_noise, len(t)) for s in ("delta_e", "delta_a", "delta_r")}
        records.append(Record(name=name, t=t, channels={**channels, **surfaces, **measured}))
    return records


def trial_of(
    one: Attached,
    gain: float = 0.0,
    spared: float = 0.0,
    fingerprint: Sequence[float] = (),
    *,
    check: KinematicCheck | None = None,
    exact: float | None = None,
    share: float = 1.0,
) -> Trial:
    """A cause that was fitted, with the gain and the size, in units of what matters, that a test needs."""
    value = one.values["value"]
    candidate = Candidate(attached=one, statistic=gain, net=gain, value=value, std=1.0, surviving=1.0)
    return Trial(
        candidate=candidate,
        std=abs(value) / max(gain, 1.0) ** 0.5,
        fingerprint=np.array(fingerprint),
        gain=Gain(raw=gain, price=0.0, spared=spared, exact=gain + spared if exact is None else exact),
        share=share,
        size=(at_least("size, of what matters", share, 1.0, "size.share"),),
        check=check or KinematicCheck(),
    )
