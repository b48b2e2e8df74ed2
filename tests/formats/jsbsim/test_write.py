"""A JSBSim file with further parts: casid reads from it what it wrote, JSBSim flies it, and its layout survives."""

from __future__ import annotations

import difflib
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

import casid as cs
from casid.errors import InputError
from casid.model.aircraft import Aircraft, EffectValue
from problems.jsbsim.agreement import file_of
from problems.jsbsim.edit import Edit, prepare
from problems.jsbsim.fleet import fleet_airframe

pytest.importorskip("jsbsim")

SERVOS = {"delta_e": "fcs/elevator-pos-rad", "delta_a": "fcs/left-aileron-pos-rad", "delta_r": "fcs/rudder-pos-rad"}


def prepared(folder: Path, model: str, edit: Edit, own: bool) -> Path:
    """The XML of an aircraft with servos, changed by `edit`; `own`: its servos write what JSBSim's surfaces are."""
    root = folder / ("own" if own else "true")
    prepare(fleet_airframe(model), edit, file_of(model).parent.parent.parent, root)
    path = root / "aircraft" / model / f"{model}.xml"
    if own:
        text = path.read_text()
        for surface, written in SERVOS.items():
            text = text.replace(f"flight/{surface}-aero", written)
        path.write_text(text)
    return path


def flown(path: Path, folder: Path) -> np.ndarray:
    """(N, 3) p, q, r of 12 s without engines, moved by multi-step commands of the surfaces."""
    import jsbsim

    root = ET.parse(path).getroot()
    for propulsion in root.findall("propulsion"):
        for node in [n for n in propulsion if n.tag != "tank"]:
            propulsion.remove(node)
    target = folder / "aircraft" / "plane"
    target.mkdir(parents=True, exist_ok=True)
    ET.ElementTree(root).write(target / "plane.xml")
    jsbsim.set_logger(jsbsim.DefaultLogger(jsbsim.LogLevel.FATAL))
    fdm = jsbsim.FGFDMExec(str(folder))
    fdm.set_debug_level(0)
    fdm.set_dt(0.005)
    assert fdm.load_model("plane")
    for name, value in {"h-sl-ft": 12000.0, "u-fps": 400.0, "w-fps": 12.0, "theta-rad": 0.03}.items():
        fdm[f"ic/{name}"] = value
    fdm.run_ic()
    rows = []
    for k in range(2400):
        t = 0.005 * k
        wave = np.clip(8.0 * np.sin(1.7 * t), -1.0, 1.0) if t > 1.0 else 0.0
        for surface, size in {"delta_e": 0.02, "delta_a": 0.03, "delta_r": 0.02}.items():
            fdm[f"flight/{surface}-command"] = size * wave
        fdm.run()
        rows.append([fdm[f"velocities/{axis}-rad_sec"] for axis in "pqr"])
    return np.array(rows)


FAULTS = {
    "aero_term": (
        Edit(term=("Cm", "alpha^2", 6.0)),
        EffectValue(kind="aero_term", target="Cm", term="alpha^2", value=6.0),
    ),
    "actuator_lag": (
        Edit(servo={"delta_e": ("actuator_lag", 0.15)}),
        EffectValue(kind="actuator_lag", target="delta_e", value=0.15),
    ),
    "rate_limit": (
        Edit(servo={"delta_e": ("rate_limit", 0.08)}),
        EffectValue(kind="rate_limit", target="delta_e", value=0.08),
    ),
    "backlash": (
        Edit(servo={"delta_r": ("backlash", 0.006)}),
        EffectValue(kind="backlash", target="delta_r", value=0.006),
    ),
    "input_delay": (
        Edit(servo={"delta_e": ("input_delay", 0.1)}),
        EffectValue(kind="input_delay", target="delta_e", value=0.1),
    ),
    "mass": (Edit(ballast_kg=250.0), EffectValue(kind="mass", value=250.0)),
    "cg_offset": (Edit(cg_shift_m={"x": 0.12}), EffectValue(kind="cg_offset", target="x", value=0.12)),
    "inertia": (Edit(inertia_kgm2={"Ixz": 900.0}), EffectValue(kind="inertia", target="Ixz", value=900.0)),
}


@pytest.mark.parametrize("kind", FAULTS)
def test_flown_again_it_matches_better(tmp_path: Path, kind: str) -> None:
    """An aircraft with a fault made in JSBSim, against the healthy file, and that file with the same fault written into
    it: nine tenths of the difference are gone."""
    edit, effect = FAULTS[kind]
    truth = flown(prepared(tmp_path, "T37", edit, own=False), tmp_path / "a")
    path = prepared(tmp_path, "T37", Edit(), own=True)
    before = flown(path, tmp_path / "b")
    Aircraft.from_jsbsim(path).with_effects([effect]).write(tmp_path / "extended.xml")
    after = flown(tmp_path / "extended.xml", tmp_path / "c")
    wrong, left = np.abs(before - truth).max(), np.abs(after - truth).max()
    assert wrong > 1e-3, "the fault must show"
    assert left < 0.1 * wrong


def rates(aircraft: Aircraft) -> np.ndarray:
    model = cs.aircraft_model(aircraft)
    f = ca.Function("f", [model.x, model.u, model.p, model.w], [model.f])
    inputs = {"delta_e": -0.03, "delta_a": 0.02, "delta_r": 0.01, "thrust": 0.0, "rho": 0.9}
    state = (120.0, 6.0, 9.0, 0.1, -0.05, 0.08, 0.2, 0.1)
    at = [inputs[name] for name in model.inputs]
    return f(state, at, model.nominal_vector(), np.zeros(len(model.disturbances))).full()[:, 0]


@pytest.mark.parametrize("model", ["737", "f16", "X15"])
def test_what_was_written_is_read_again(tmp_path: Path, model: str) -> None:
    """Increments of all six coefficients, in wind or body axes, about the c.g.: file and aircraft say the same."""
    aircraft = Aircraft.from_jsbsim(file_of(model))
    extended = replace(
        aircraft.with_derivatives(
            {
                "CL_0": 0.05,
                "CL_alpha": 0.4,
                "CD_alpha": 0.1,
                "CY_beta": -0.2,
                "Cl_p": -0.1,
                "Cm_q": -3.0,
                "Cn_delta_r": 0.02,
            }
        ).with_terms(
            {
                "Cm": {"alpha^2": 3.0, "alpha[0.05,0.09,0.2,0.3]": 0.1},
                "CD": {"beta^2": 0.5, "|delta_e|": 0.4},
                "Cl": {"alpha*beta": 0.4},
            }
        ),
        effects=(EffectValue(kind="unsteady_aero", target="Cm", value=-4.0),),
    )
    extended.write(tmp_path / "extended.xml")
    np.testing.assert_allclose(rates(Aircraft.read(tmp_path / "extended.xml")), rates(extended), rtol=1e-9, atol=1e-10)
    assert np.abs(rates(aircraft) - rates(extended)).max() > 0.1


def test_every_line_of_the_file_survives(tmp_path: Path) -> None:
    """Comments, order and layout: the old lines are the new file's, with lines between them and one number changed."""
    path = tmp_path / "c310.xml"
    path.write_text(file_of("c310").read_text(encoding="utf-8"), encoding="utf-8")
    aircraft = Aircraft.from_jsbsim(path).with_derivatives({"Cm_alpha": 0.2})
    aircraft.with_effects(
        [EffectValue(kind="inertia", target="Iyy", value=100.0), EffectValue(kind="mass", value=50.0)]
    ).write(tmp_path / "extended.xml")
    old, new = (p.read_text().splitlines() for p in (path, tmp_path / "extended.xml"))
    gone = [line for line in difflib.ndiff(old, new) if line.startswith("- ")]
    assert len(gone) == 1 and "<iyy" in gone[0]
    again = Aircraft.read(tmp_path / "extended.xml")
    assert again.mass == pytest.approx(aircraft.mass + 50.0, rel=1e-9)
    assert again.inertia.Iyy == pytest.approx(aircraft.inertia.Iyy + 100.0, rel=1e-9)


def test_what_cannot_be_written_is_said_in_the_file(tmp_path: Path) -> None:
    path = tmp_path / "c310.xml"
    path.write_text(file_of("c310").read_text(encoding="utf-8"), encoding="utf-8")
    Aircraft.from_jsbsim(path).with_effects(
        [
            EffectValue(kind="sensor_bias", target="q", value=0.01),
            EffectValue(kind="aero_term", target="Cm", term="delta_e*Tc", value=1.0),
            EffectValue(kind="mass", value=30.0, records=("m1",)),
        ]
    ).write(tmp_path / "extended.xml")
    text = (tmp_path / "extended.xml").read_text()
    assert "sensor_bias(q) 0.01 rad/s: it has no place in a JSBSim file" in text
    assert "Cm: 1 times delta_e*Tc, of which JSBSim has no property" in text
    assert "mass 30 kg: it is not in all records" in text
    np.testing.assert_allclose(rates(Aircraft.read(tmp_path / "extended.xml")), rates(Aircraft.read(path)), rtol=1e-12)


def test_an_aircraft_of_no_jsbsim_file_cannot_be_xml(tmp_path: Path) -> None:
    from problems.do328 import do328

    with pytest.raises(InputError, match=r"plane\.xml: only an aircraft of a JSBSim file"):
        do328().write(tmp_path / "plane.xml")
