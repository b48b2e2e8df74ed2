"""Truth: published optima at published parameters, by LSODA; a small model of one's own with a solution on paper."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

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

SBML = """<?xml version="1.0" encoding="UTF-8"?>
<sbml xmlns="http://www.sbml.org/sbml/level3/version1/core" level="3" version="1">
 <model id="dosed">
  <listOfFunctionDefinitions><functionDefinition id="first_order">
   <math xmlns="http://www.w3.org/1998/Math/MathML"><lambda><bvar><ci>k</ci></bvar><bvar><ci>x</ci></bvar>
    <apply><times/><ci>k</ci><ci>x</ci></apply></lambda></math></functionDefinition></listOfFunctionDefinitions>
  <listOfCompartments><compartment id="cell" size="2" constant="true"/></listOfCompartments>
  <listOfSpecies><species id="A" compartment="cell" initialConcentration="4" hasOnlySubstanceUnits="false"
   boundaryCondition="false" constant="false"/></listOfSpecies>
  <listOfParameters>
   <parameter id="k" value="0.5" constant="true"/><parameter id="dose" value="1.5" constant="true"/>
   <parameter id="feed" value="0" constant="true"/><parameter id="t_dose" value="2" constant="true"/>
   <parameter id="t_feed" value="1" constant="true"/><parameter id="inflow" constant="false"/>
  </listOfParameters>
  <listOfInitialAssignments><initialAssignment symbol="A"><math xmlns="http://www.w3.org/1998/Math/MathML">
   <ci>A0</ci></math></initialAssignment></listOfInitialAssignments>
  <listOfRules><assignmentRule variable="inflow"><math xmlns="http://www.w3.org/1998/Math/MathML"><piecewise>
   <piece><ci>feed</ci><apply><lt/><csymbol encoding="text" definitionURL="http://www.sbml.org/sbml/symbols/time">t
    </csymbol><ci>t_feed</ci></apply></piece><otherwise><cn>0</cn></otherwise></piecewise></math></assignmentRule>
  </listOfRules>
  <listOfReactions>
   <reaction id="decay" reversible="false" fast="false"><listOfReactants>
    <speciesReference species="A" stoichiometry="1" constant="true"/></listOfReactants>
    <kineticLaw><math xmlns="http://www.w3.org/1998/Math/MathML"><apply><times/><ci>cell</ci>
     <apply><ci>first_order</ci><ci>k</ci><ci>A</ci></apply></apply></math></kineticLaw></reaction>
   <reaction id="feeding" reversible="false" fast="false"><listOfProducts>
    <speciesReference species="A" stoichiometry="1" constant="true"/></listOfProducts>
    <kineticLaw><math xmlns="http://www.w3.org/1998/Math/MathML"><apply><times/><ci>cell</ci><ci>inflow</ci></apply>
    </math></kineticLaw></reaction>
  </listOfReactions>
  <listOfEvents><event id="injection" useValuesFromTriggerTime="true"><trigger initialValue="true" persistent="true">
   <math xmlns="http://www.w3.org/1998/Math/MathML"><apply><geq/>
    <csymbol encoding="text" definitionURL="http://www.sbml.org/sbml/symbols/time">t</csymbol><ci>t_dose</ci></apply>
   </math></trigger><listOfEventAssignments><eventAssignment variable="A">
    <math xmlns="http://www.w3.org/1998/Math/MathML"><apply><plus/><ci>A</ci><ci>dose</ci></apply></math>
   </eventAssignment></listOfEventAssignments></event></listOfEvents>
 </model>
</sbml>
"""
A0 = '<parameter id="A0" value="4" constant="true"/>'
T = np.arange(0.25, 5.1, 0.25)
CONDITIONS = {"plain": (1.5, 0.0, "A0"), "fed": (0.5, 2.0, "A0"), "other": (0.0, 1.0, "A1")}
TRUTH = {"k": 0.7, "A0": 3.0, "A1": 6.0, "scale": 2.0, "sigma": 0.05}


def motion(t: np.ndarray, dose: float, feed: float, begin: float, k: float) -> np.ndarray:
    """A(t) on paper: decay, a feed until t = 1 and a dose at t = 2."""
    until = np.minimum(t, 1.0)
    fed = feed / k * (np.exp(-k * (t - until)) - np.exp(-k * t))
    return begin * np.exp(-k * t) + fed + np.where(t >= 2.0, dose * np.exp(-k * (t - 2.0)), 0.0)


def write(folder: Path, noise: str = "sigma * noiseParameter1_y", scale: str = "log10", **files: str) -> Path:
    """A problem of three conditions, with readings of A by two gains, noise by formula and a log-normal one."""
    rng = np.random.default_rng(11)
    rows = ["observableId\tsimulationConditionId\tmeasurement\ttime\tobservableParameters\tnoiseParameters"]
    for name, (dose, feed, begin) in CONDITIONS.items():
        a = motion(T, dose, feed, TRUTH[begin], TRUTH["k"])
        for i, t in enumerate(T):
            gain, sigma = (TRUTH["scale"], 1.0) if i % 2 else (3.0, 2.0)
            y = gain * a[i] * 10.0 ** (0.05 * sigma * rng.standard_normal())
            rows.append(f"y\t{name}\t{float(y)!r}\t{t}\t{'scale' if i % 2 else '3.0'}\t{sigma}")
    content = {
        "model.xml": SBML.replace('<parameter id="k"', A0 + '<parameter id="k"', 1),
        "conditions.tsv": "conditionId\tdose\tfeed\tA0\n"
        + "".join(f"{n}\t{d}\t{f}\t{b}\n" for n, (d, f, b) in CONDITIONS.items()).replace("\tA0\n", "\tstart\n"),
        "observables.tsv": "observableId\tobservableFormula\tnoiseFormula\tobservableTransformation"
        "\tnoiseDistribution\n"
        f"y\tobservableParameter1_y * A\t{noise}\t{scale}\tnormal\n",
        "measurements.tsv": "\n".join(rows) + "\n",
        "parameters.tsv": "parameterId\tparameterScale\tlowerBound\tupperBound\tnominalValue\testimate\n"
        "k\tlog10\t1e-3\t10\t0.5\t1\nstart\tlog10\t0.1\t100\t4\t1\nA1\tlin\t0.1\t100\t5\t1\n"
        "scale\tlog10\t0.1\t10\t1\t1\nsigma\tlog10\t1e-3\t1\t0.1\t1\n",
        "problem.yaml": "format_version: 1\nparameter_file: parameters.tsv\nproblems:\n"
        "- condition_files: [conditions.tsv]\n"
        "  measurement_files: [measurements.tsv]\n  observable_files: [observables.tsv]\n  sbml_files: [model.xml]\n",
    } | files
    for name, text in content.items():
        (folder / name).write_text(text)
    return folder / "problem.yaml"


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


def test_a_fit_from_twice_the_published_parameters_is_never_below_its_start(petab_data: Path) -> None:
    """Crauste, where the fit once crashed: in three seconds it is more likely than its start, by LSODA too, and has not
    converged where LSODA contradicts."""
    name = "Crauste_CellSystems2017"
    if not (petab_data / name).is_dir():
        pytest.skip(f"no {name} among the PEtab problems")
    problem = times(cs.read_petab(petab_data / name / f"{name}.yaml"), 2.0)
    by_lsoda = Likelihood(problem, 1e-8)
    begun = by_lsoda(dict(zip(problem.parameters, problem.start_vector, strict=True)))
    fit = cs.solve(problem, solver=cs.Automatic(seconds=8.0))
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
    with pytest.raises(InputError, match="not a PEtab problem"):
        cs.read_petab(tmp_path / "none.yaml")
    with pytest.raises(EstimationError, match="laplace"):
        path = write(tmp_path)
        table = tmp_path / "observables.tsv"
        table.write_text(table.read_text().replace("\tnormal", "\tlaplace"))
        cs.read_petab(path)
    with pytest.raises(InputError, match="did you mean 'sigma'"):
        cs.read_petab(write(tmp_path, noise="sigmo * noiseParameter1_y"))
    with pytest.raises(InputError, match="is no formula"):
        cs.read_petab(write(tmp_path, noise="sigma * * 2"))
    clock = '<csymbol encoding="text" definitionURL="http://www.sbml.org/sbml/symbols/time">t</csymbol><ci>t_dose</ci>'
    broken = SBML.replace(clock, "<ci>A</ci><ci>t_dose</ci>").replace('<parameter id="k"', A0 + '<parameter id="k"', 1)
    with pytest.raises(InputError, match="known time"):
        cs.read_petab(write(tmp_path, **{"model.xml": broken}))
