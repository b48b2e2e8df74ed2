"""Fly recorded inputs through aircraft files, side by side.

Question     how well does each aircraft file, original or extended, simulate what was measured?
Set-up       every RECORD through every FILE, open loop on the recorded inputs, from the initial state that fits the
             record's first seconds best. Effects of the file act, those of instruments on what is read; turbulence does
             not, because it is not known in advance.
Expectation  DIR/<record>__<aircraft>.csv, the record with its outputs simulated; DIR/simulate.json with r.m.s., R2 and
             Theil's coefficient per channel; DIR/figures; a table. A simulation that diverges is said, not an error.

    python scripts/simulate.py RECORD ... --aircraft FILE [FILE2 ...] [--axes full|longitudinal|lateral]
        [--map CHANNEL=COLUMN:unit] [--out DIR]
"""

from casid.cli.app import run_as_script

if __name__ == "__main__":
    run_as_script("simulate")
