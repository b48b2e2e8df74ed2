"""A flight simulator that shares no code with casid, as an independent truth for the diagnosis.

Equations of motion (quaternions, flat earth, RK4), aerodynamic tables, actuators, engine, atmosphere, moving air,
instruments and hidden effects are written here in numpy; no file of this folder imports `casid`. The one that hands
records and aircraft file to the diagnosis is `problems/blind/independent.py`. The campaign is

    python scripts/blind.py --sets independent --seeds 3001

and its results are in `results.md`. Both aircraft are inventions: their numbers are of the size that textbooks give for
a light single and a small jet (J. Roskam, Airplane Flight Dynamics and Automatic Flight Controls, part I, appendix B),
and describe no real aircraft.
"""
