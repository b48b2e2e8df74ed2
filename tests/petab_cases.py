"""A PEtab problem of three conditions, with a solution on paper."""

from __future__ import annotations

from pathlib import Path

import numpy as np

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
