"""Truth: published optima at published parameters, by LSODA; a small model of one's own with a solution on paper."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from petab_cases import A0, CONDITIONS, SBML, TRUTH, motion, write

import casid as cs
from casid.errors import EstimationError, InputError
from problems.references.petab import TOLERANCES, Likelihood, times

# -ln(likelihood) at the nominal parameters: the PEtab benchmark collection (Hass et al., Bioinformatics 35, 2019)
PUBLISHED = {
    "Rahman_MBS2016": 21.1535,
    "Crauste_CellSystems2017": 190.964,
    "Elowitz_Nature2000": -63.203,
    "Fujita_SciSignal2010": -53.084,
}


def on_paper(problem: cs.Problem, values) -> float:
    """-ln(likelihood) of log10-normal readings: the density of z has 1/(z ln 10) in it."""
    total = 0.0
    for record in problem.records:
        dose, feed, begin = CONDITIONS[record.name]
        there = np.isfinite(record["y"])
        t, z = record.t[there], record["y"][there]
        odd = np.isclose(t / 0.25 % 2, 0.0)
        y = np.where(odd, values["scale"], 3.0) * motion(
            t, dose, feed, values[begin.replace("A0", "start")], values["k"]
        )
        s = values["sigma"] * np.where(odd, 1.0, 2.0)
        density = 0.5 * (np.log10(z / y) / s) ** 2 + np.log(s * z * math.log(10.0) * math.sqrt(2.0 * math.pi))
        total += float(density.sum())
    return total


@pytest.mark.parametrize("name", PUBLISHED)
def test_the_likelihood_at_the_published_parameters_is_the_published_one(name: str, petab_data: Path) -> None:
    if not (petab_data / name).is_dir():
        pytest.skip(f"no {name} among the PEtab problems")
    problem = cs.read_petab(petab_data / name / f"{name}.yaml")
    start = dict(zip(problem.parameters, problem.start_vector, strict=True))
    assert Likelihood(problem, TOLERANCES[name])(start) == pytest.approx(PUBLISHED[name], abs=6e-4)


@pytest.mark.parametrize(
    "name, converged",
    [
        ("Rahman_MBS2016", False),  # three of nine parameters change nothing
        pytest.param("Crauste_CellSystems2017", True, marks=pytest.mark.slow),
    ],
)
def test_a_published_optimum_is_confirmed_and_its_status_is_right(name, converged, petab_data: Path) -> None:
    if not (petab_data / name).is_dir():
        pytest.skip(f"no {name} among the PEtab problems")
    problem = cs.read_petab(petab_data / name / f"{name}.yaml")
    fit = cs.solve(problem)
    assert -fit.log_likelihood == pytest.approx(PUBLISHED[name], abs=0.01)
    assert Likelihood(problem, 1e-10)(fit.values) == pytest.approx(-fit.log_likelihood, abs=0.01)
    assert fit.result is (cs.Results.CONVERGED if converged else cs.Results.NOT_IDENTIFIABLE)


@pytest.mark.slow
def test_a_fit_from_twice_the_published_parameters_is_never_below_its_start(petab_data: Path, monkeypatch) -> None:
    """Crauste, where the fit once crashed: after two steps it is more likely than its start, by LSODA too, and has not
    converged where LSODA contradicts."""
    name = "Crauste_CellSystems2017"
    if not (petab_data / name).is_dir():
        pytest.skip(f"no {name} among the PEtab problems")
    monkeypatch.setenv("CASID_COMPILE_FIRST", "1")  # what is tried does not depend on when a kernel is there
    problem = times(cs.read_petab(petab_data / name / f"{name}.yaml"), 2.0)
    by_lsoda = Likelihood(problem, 1e-8)
    begun = by_lsoda(dict(zip(problem.parameters, problem.start_vector, strict=True)))
    fit = cs.solve(problem, solver=cs.Automatic(iterations=2))
    ended = by_lsoda(fit.values)
    assert ended < begun and -fit.log_likelihood < begun
    assert not fit.converged or ended == pytest.approx(-fit.log_likelihood, abs=0.01)


def test_conditions_doses_switches_and_noise_are_those_of_the_formula_on_paper(tmp_path: Path) -> None:
    problem = cs.read_petab(write(tmp_path))
    assert [record.name for record in problem.records] == ["plain", "fed", "other"]
    assert set(problem.parameters) == {"k", "start", "A1", "scale", "sigma"}
    for values in (dict(zip(problem.parameters, problem.start_vector, strict=True)), {**TRUTH, "start": 3.0}):
        given = {name: values[name] for name in problem.parameters}
        assert Likelihood(problem)(given) == pytest.approx(on_paper(problem, given), abs=1e-4)


def test_the_fit_is_the_minimum_on_paper(tmp_path: Path) -> None:
    problem = cs.read_petab(write(tmp_path))
    fit = cs.solve(problem)
    assert fit.converged, fit.status
    assert -fit.log_likelihood == pytest.approx(on_paper(problem, fit.values), abs=0.01)
    at = np.array([fit.values[n] for n in problem.parameters])
    for i in range(len(at)):
        for side in (0.98, 1.02):
            other = dict(zip(problem.parameters, at * np.where(np.arange(len(at)) == i, side, 1.0), strict=True))
            assert on_paper(problem, other) > on_paper(problem, fit.values)
    truth = {**TRUTH, "start": 3.0}
    for name in problem.parameters:
        assert fit[name].value == pytest.approx(truth[name], abs=5.0 * fit[name].std)


def test_an_event_that_multiplies_a_state_is_taken(tmp_path: Path) -> None:
    """At t = 2 A becomes dose times A: exact, as no step of integration crosses it."""
    times = SBML.replace("<plus/><ci>A</ci>", "<times/><ci>A</ci>").replace(
        '<parameter id="k"', A0 + '<parameter id="k"', 1
    )
    problem = cs.read_petab(write(tmp_path, **{"model.xml": times}))
    record, values = problem.records[0], dict(problem.fixed_in("plain")) | {"k": 0.7}
    found = cs.simulate(problem.model, record, [3.0], values, integrator="cvodes").state("A")
    assert found == pytest.approx(3.0 * np.exp(-0.7 * record.t) * np.where(record.t >= 2.0, 1.5, 1.0), rel=1e-8)


def test_a_repeated_measurement_is_a_record_of_its_own(tmp_path: Path) -> None:
    path = write(tmp_path)
    table = tmp_path / "measurements.tsv"
    table.write_text(table.read_text() + "y\tfed\t5.0\t0.5\tscale\t1.0\n")
    problem = cs.read_petab(path)
    assert [record.name for record in problem.records] == ["plain", "fed", "fed, 2", "other"]
    assert problem.fixed["feed[fed, 2]"] == 2.0 and np.isfinite(problem.records[2]["y"]).sum() == 1


def test_what_is_not_taken_is_said(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"none\.yaml"):
        cs.read_petab(tmp_path / "none.yaml")
    with pytest.raises(EstimationError, match="laplace"):
        path = write(tmp_path)
        table = tmp_path / "observables.tsv"
        table.write_text(table.read_text().replace("\tnormal", "\tlaplace"))
        cs.read_petab(path)
    with pytest.raises(InputError, match="did you mean 'sigma'"):
        cs.read_petab(write(tmp_path, noise="sigmo * noiseParameter1_y"))
    for noise in ("sigma * * 2", "sigma * min()", "sigma * (1 < 2 < 3)", "sigma * foo(2)", "sigma * and()"):
        with pytest.raises(InputError):
            cs.read_petab(write(tmp_path, noise=noise))
    clock = '<csymbol encoding="text" definitionURL="http://www.sbml.org/sbml/symbols/time">t</csymbol><ci>t_dose</ci>'
    broken = SBML.replace(clock, "<ci>A</ci><ci>t_dose</ci>").replace('<parameter id="k"', A0 + '<parameter id="k"', 1)
    with pytest.raises(InputError, match="known time"):
        cs.read_petab(write(tmp_path, **{"model.xml": broken}))
    path = write(tmp_path)
    table = tmp_path / "measurements.tsv"
    rows = [line.split("\t") for line in table.read_text().splitlines()]
    itself = (rows[0], *([*row[:-1], "noiseParameter1_y"] for row in rows[1:]))
    table.write_text("\n".join("\t".join(row) for row in itself))
    with pytest.raises(InputError, match="in a circle"):
        cs.read_petab(path)


@pytest.mark.parametrize("version", range(1, 6))
@pytest.mark.parametrize("level", range(1, 5))
def test_a_level_and_version_are_read_or_refused_in_one_line(level: int, version: int, tmp_path: Path) -> None:
    """libsbml ends its process where the name space is of another level than the attribute says."""
    text = SBML.replace('level="3" version="1">', f'level="{level}" version="{version}">')
    text = text.replace('<parameter id="k"', A0 + '<parameter id="k"', 1)
    path = write(tmp_path, **{"model.xml": text})
    if (level, version) == (3, 1):
        assert cs.read_petab(path).records
        return
    with pytest.raises(InputError) as fault:
        cs.read_petab(path)
    assert "model.xml" in str(fault.value) and "\n" not in str(fault.value)


@pytest.mark.parametrize("deep", [50, 1000, 100_000])
def test_a_formula_of_any_depth_is_taken_or_refused(deep: int, tmp_path: Path) -> None:
    inside = "<ci>inflow</ci>"
    nested = "<apply><minus/>" * deep + inside + "</apply>" * deep
    text = SBML.replace(f"<ci>cell</ci>{inside}", f"<ci>cell</ci>{nested}")
    path = write(tmp_path, **{"model.xml": text.replace('<parameter id="k"', A0 + '<parameter id="k"', 1)})
    if deep == 50:
        assert cs.read_petab(path).records
        return
    with pytest.raises(InputError) as fault:
        cs.read_petab(path)
    assert "model.xml" in str(fault.value) and "\n" not in str(fault.value)
