"""A motion capture that is late. Truth: a quadrotor by Newton and Euler in numpy, whose pose was read earlier."""

from __future__ import annotations

import numpy as np
import pytest

import casid as cs
from casid.diagnosis.criteria import Criteria
from casid.diagnosis.evidence.evidence import weigh
from casid.diagnosis.evidence.screening import screen
from casid.diagnosis.flight import rotorcraft
from casid.diagnosis.flight.fit import fit
from casid.diagnosis.flight.hypothesis import Attached
from casid.model.causes.instruments import SENSOR_GROUPS
from problems.rotors.newton import Craft, G, flight, quad

MASS = 0.8
INERTIA = np.diag([4.5e-3, 4.5e-3, 8.3e-3])
HOVER = 0.25 * MASS * G  # N of a rotor
LATE = 0.06  # s


def flown(late: float) -> tuple[cs.Aircraft, cs.Record]:
    places, spins = quad(0.106)
    craft = Craft(
        places=places,
        spins=spins,
        mass=lambda t: MASS,
        inertia=INERTIA,
        thrust=lambda t, u: HOVER * (0.1 + 1.8 * u),
        input_for=lambda thrust: np.clip((thrust / HOVER - 0.1) / 1.8, 0.0, 1.0),
        torque=0.02,
        lag=0.05,
    )
    rotors = [
        cs.Rotor(
            name=f"m{i}",
            position=tuple(map(float, place)),
            spin=float(spin),
            thrust=(0.1 * HOVER, 1.8 * HOVER),
            torque=0.02,
            lag=0.05,
            std=0.03,
        )
        for i, (place, spin) in enumerate(zip(places, spins, strict=True), start=1)
    ]
    J = INERTIA.diagonal()
    inertia = cs.Inertia(Ixx=J[0], Iyy=J[1], Izz=J[2], Ixz=0.0)
    aircraft = cs.Aircraft(name="quad", mass=MASS, inertia=inertia, rotors=cs.Rotors(each=rotors))
    channels = flight(craft, 5)
    t = channels.pop("t")
    step = round(late / (t[1] - t[0]))
    pose = set(SENSOR_GROUPS["external"])
    kept = {name: values[: len(t) - step] if name in pose else values[step:] for name, values in channels.items()}
    return aircraft, cs.Record.from_arrays(
        name="capture", t=t[step:], channels=kept, units=dict.fromkeys("pqr", "rad/s")
    )


@pytest.fixture
def noise_of_the_high_band(monkeypatch: pytest.MonkeyPatch) -> None:
    """The most likely noise beside a file without a delay has a gyro 20 times as noisy, which hides the delay."""
    monkeypatch.setattr(rotorcraft, "_with_noise", lambda flight, base, by_band: flight)


@pytest.mark.slow
@pytest.mark.usefixtures("noise_of_the_high_band")
def test_one_delay_explains_more_than_that_of_any_part_and_leaves_none_of_it() -> None:
    """In white noise it has its size, to 3 %."""
    aircraft, record = flown(LATE)
    subject, _ = rotorcraft.rotorcraft(aircraft, [record], Criteria())
    offered = {one.name: one for one in subject.effects if one.kind == "sensor_delay"}
    assert {"sensor_delay(external)", "sensor_delay(ground)", "sensor_delay(attitude)"} <= offered.keys()
    plain = fit(subject, (), subject.noise(), extent="settled")
    promising = screen(weigh(plain), list(offered.values()))[:2]
    assert "sensor_delay(external)" in {one.name for one in promising}
    gains = {}
    for name in ("external", "attitude", "ground"):
        one = Attached(effect=offered[f"sensor_delay({name})"], values={"value": 0.05})
        found = fit(subject, [one], subject.noise(), plain, extent="settled")
        gains[name] = plain.deviance - found.deviance
        if name == "external":
            assert found.attached[0].values["value"] == pytest.approx(LATE, rel=0.03)
            left = screen(weigh(found), [effect for key, effect in offered.items() if "external" not in key])
            assert all(one.net < 1e-3 * gains["external"] for one in left)
    assert gains["external"] > gains["attitude"] + subject.criteria.significance.search
    assert gains["attitude"] > gains["ground"]


@pytest.mark.slow
def test_a_pose_in_time_is_no_cause() -> None:
    aircraft, record = flown(0.0)
    assert not cs.diagnose(aircraft, [record]).causes
