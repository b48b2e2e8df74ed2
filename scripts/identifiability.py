"""Which derivatives can these records tell apart, which did they not move, and which manoeuvre would help?

Question     weak directions of the scaled information matrix in words, what the a-priori values did, what to fly next
Set-up       an aircraft file and flight records; output error, multiple shooting, all derivatives of the file free
             without a prior. With no record: the first of the demonstration records.
Expectation  one manoeuvre leaves directions that another, named with its gain, would open. DIR/identifiability.txt,
             DIR/identifiability.json.

    python scripts/identifiability.py [RECORD ... --aircraft FILE] [--free GLOB ...] [--axes AXES] [--map ...]
        [--out DIR]
"""

from casid.cli.app import run_as_script

if __name__ == "__main__":
    run_as_script("identifiability")
