"""Functional mock-up units: two of the reference FMUs' equations, built here from C, against their closed forms."""

from __future__ import annotations

import shutil
import subprocess
import zipfile
from collections.abc import Callable
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

import casid as cs
from casid.errors import InputError
from casid.records.record import Record

SCALAR = '<ScalarVariable name="{}" valueReference="{}" causality="{}" variability="{}"{}><Real {}/></ScalarVariable>'
UNITS = {
    "VanDerPol": [
        ("x0", "output", "continuous", ' initial="exact"', 'start="2"'),
        ("der(x0)", "local", "continuous", "", 'derivative="1"'),
        ("x1", "output", "continuous", ' initial="exact"', 'start="0"'),
        ("der(x1)", "local", "continuous", "", 'derivative="3"'),
        ("mu", "parameter", "fixed", ' initial="exact"', 'start="1"'),
        ("force", "input", "continuous", "", 'start="0"'),
    ],
    "Dahlquist": [
        ("x", "output", "continuous", ' initial="exact"', 'start="1"'),
        ("der(x)", "local", "continuous", "", 'derivative="1"'),
        ("k", "parameter", "fixed", ' initial="exact"', 'start="1"'),
    ],
}


def description(name: str, indicators: int = 0) -> str:
    rows = [SCALAR.format(row[0], i, *row[1:]) for i, row in enumerate(UNITS[name])]
    rates = [i + 1 for i, row in enumerate(UNITS[name]) if "derivative" in row[-1]]
    unknowns = {"Outputs": [i - 1 for i in rates], "Derivatives": rates}
    entries = {kind: "".join(f'<Unknown index="{i}"/>' for i in indices) for kind, indices in unknowns.items()}
    structure = "".join(f"<{kind}>{entry}</{kind}>" for kind, entry in entries.items())
    return (
        f'<fmiModelDescription fmiVersion="2.0" modelName="{name}" guid="1" numberOfEventIndicators="{indicators}">'
        f'<ModelExchange modelIdentifier="{name}"/><ModelVariables>{"".join(rows)}</ModelVariables>'
        f"<ModelStructure>{structure}</ModelStructure></fmiModelDescription>"
    )


@pytest.fixture(scope="module")
def unit(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """Name -> an .fmu for Linux, compiled once."""
    fmpy = pytest.importorskip("fmpy", reason="no FMU: pip install 'casid[fmu]'")
    compiler = shutil.which("gcc") or shutil.which("cc")
    if compiler is None or fmpy.platform != "linux64":
        pytest.skip("no FMU can be built: there is no C compiler for Linux")
    headers, built = Path(fmpy.__file__).parent / "c-code", dict[str, Path]()

    def build(name: str) -> Path:
        if name not in built:
            folder = tmp_path_factory.mktemp(name)
            defined = ["-DDAHLQUIST"] if name == "Dahlquist" else []
            source = Path(__file__).parent / "two_fmus.c"
            command = [compiler, "-shared", "-fPIC", "-O1", *defined, f"-I{headers}", source, "-o", folder / "unit.so"]
            subprocess.run([str(part) for part in command], check=True, capture_output=True)
            built[name] = folder / f"{name}.fmu"
            with zipfile.ZipFile(built[name], "w") as archive:
                archive.writestr("modelDescription.xml", description(name))
                archive.write(folder / "unit.so", f"binaries/linux64/{name}.so")
        return built[name]

    return build


def oscillator(unit: Callable[[str], Path]) -> cs.Model:
    return cs.fmu_model(unit("VanDerPol"), ["mu"], prior_std={"mu": 0.3})


def written_out() -> cs.Model:
    """The same by its equations."""
    return cs.define_model(
        "van der Pol",
        states=("x0", "x1"),
        inputs=("force",),
        parameters={"mu": 1.0},
        outputs=("x0", "x1"),
        dynamics=lambda s: {"x0": s.x1, "x1": s.mu * (1.0 - s.x0**2) * s.x1 - s.x0 + s.force},
        output=lambda s: {"x0": s.x0, "x1": s.x1},
    )


def pushed(name: str, seed: int) -> Record:
    rng, t = np.random.default_rng(seed), np.arange(0.0, 3.0, 0.05)
    force = np.interp(t, np.arange(0.0, 3.5, 0.5), rng.normal(scale=2.0, size=7))
    return Record(name=name, t=t, channels={"force": force})


def flown(name: str, seed: int, mu: float, noise: float = 0.02) -> Record:
    """By the equations, with noise."""
    record = pushed(name, seed)
    read = cs.simulate(written_out(), record, [2.0, 0.0], {"mu": mu}, substeps=4).as_record(name)
    rng = np.random.default_rng([seed, 1])
    return read.with_channels(**{x: read[x] + noise * rng.standard_normal(len(read.t)) for x in ("x0", "x1")})


def test_rates_outputs_and_their_derivatives(unit: Callable[[str], Path]) -> None:
    """d(x1')/dmu = (1 - x0^2) x1, which no dependency of a model description says."""
    model = oscillator(unit)
    assert (model.states, model.inputs, model.outputs) == (("x0", "x1"), ("force",), ("x0", "x1"))
    assert dict(model.nominal) == {"mu": 1.0}
    every = ca.vertcat(model.x, model.u, model.p)
    at = ca.Function("at", [every], [model.f, model.h, ca.jacobian(model.f, every)])
    rng = np.random.default_rng(3)
    for x0, x1, force, mu in rng.uniform(-3.0, 3.0, (20, 4)):
        f, h, slopes = (np.asarray(one.full()) for one in at([x0, x1, force, mu]))
        exact = [x1, mu * (1.0 - x0**2) * x1 - x0 + force]
        np.testing.assert_allclose(f[:, 0], exact, atol=1e-9)
        np.testing.assert_allclose(h[:, 0], [x0, x1], atol=1e-9)
        rows = [[0.0, 1.0, 0.0, 0.0], [-2.0 * mu * x0 * x1 - 1.0, mu * (1.0 - x0**2), 1.0, (1.0 - x0**2) * x1]]
        np.testing.assert_allclose(slopes, rows, atol=1e-7)


def test_motion_of_dahlquists_equation(unit: Callable[[str], Path]) -> None:
    """x = exp(-k t), k set to other values than the start, there and back."""
    model = cs.fmu_model(unit("Dahlquist"), ["k"])
    record = Record(name="m", t=np.linspace(0.0, 2.0, 41), channels={})
    for k in (0.5, 2.0, 0.5):
        motion = cs.simulate(model, record, [1.0], {"k": k}, substeps=10)
        np.testing.assert_allclose(motion.output("x"), np.exp(-k * record.t), rtol=1e-9)
    held = cs.fmu_model(unit("Dahlquist"))
    assert held.parameters == ()
    np.testing.assert_allclose(cs.simulate(held, record, [1.0], substeps=10).output("x"), np.exp(-record.t), rtol=1e-9)


def test_an_estimation_finds_the_parameter_as_by_the_equations(unit: Callable[[str], Path]) -> None:
    record = flown("m", 1, mu=1.4)
    fits = [
        cs.solve(cs.Problem(model, [record], free=["mu"]), cs.MultipleShooting(substeps=1))
        for model in (oscillator(unit), written_out())
    ]
    assert all(fit.converged for fit in fits)
    assert fits[0]["mu"].value == pytest.approx(1.4, abs=3.0 * fits[0]["mu"].std)
    assert fits[0]["mu"].value == pytest.approx(fits[1]["mu"].value, abs=0.05 * fits[1]["mu"].std)


@pytest.mark.slow
def test_a_hidden_fault_is_found_through_it(unit: Callable[[str], Path]) -> None:
    """x = exp(-1.2 t), and the instrument reads 0.1 too much."""
    records, t = [], np.arange(0.0, 3.0, 0.1)
    for k, begin in enumerate((1.0, -2.0)):
        noise = np.random.default_rng(k).normal(scale=0.004, size=len(t))
        records.append(Record(name=f"m{k}", t=t, channels={"x": begin * np.exp(-1.2 * t) + 0.1 + noise}))
    model = cs.fmu_model(unit("Dahlquist"), ["k"], prior_std={"k": 0.3})
    found = cs.diagnose(model, records)
    assert [(cause.kind, cause.target) for cause in found.causes] == [("sensor_bias", "x")]
    assert found.causes[0].value == pytest.approx(0.1, abs=0.01)
    assert found.system.extended.nominal["k"] == pytest.approx(1.2, abs=0.03)


def test_what_cannot_be_read_is_said(unit: Callable[[str], Path], tmp_path: Path) -> None:
    good = unit("VanDerPol")

    def like(name: str, text: str) -> Path:
        with zipfile.ZipFile(good) as old, zipfile.ZipFile(tmp_path / name, "w") as new:
            new.writestr("modelDescription.xml", text)
            if name != "other.fmu":
                new.writestr("binaries/linux64/VanDerPol.so", old.read("binaries/linux64/VanDerPol.so"))
        return tmp_path / name

    (tmp_path / "text.fmu").write_text("no archive")
    kept = description("VanDerPol")
    cases = [
        (tmp_path / "none.fmu", (), "no such file"),
        (tmp_path / "text.fmu", (), "is no FMU"),
        (good, ("my",), "unknown parameter 'my'; did you mean 'mu'"),
        (like("jumps.fmu", description("VanDerPol", indicators=2)), (), "2 event indicators"),
        (like("cs.fmu", kept.replace("ModelExchange", "CoSimulation")), (), "expected FMI 2.0 for model exchange"),
        (like("int.fmu", kept.replace('<Real start="0"/></Sc', '<Integer start="0"/></Sc')), (), "input 'force' is of"),
        (like("other.fmu", kept), (), "does not run here"),
    ]
    for path, parameters, message in cases:
        with pytest.raises(InputError, match=message) as caught:
            cs.fmu_model(path, parameters)
        assert "\n" not in str(caught.value)
