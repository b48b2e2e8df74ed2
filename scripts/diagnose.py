"""What does the simulation get wrong, why, and how much better is the extended model on data it never saw?

Question     the aircraft file flies the recorded inputs; where and why does it miss what was measured?
Set-up       RECORD ... are fitted, --hold-out RECORD ... are only used to judge. Without --hold-out the last record is
             held back, or of a single one its last third. Without any record: the embedded Fokker 50, whose elevator
             lags its command by 0.12 s, which the aircraft file does not know.
Expectation  DIR/report.html (one page for a person), DIR/diagnosis.json (the same for a program), DIR/extended.toml
             (an aircraft file with the causes that were found), DIR/report_figures, DIR/run.json (made with what).
             Status 0 whatever is found; 2 and one line for bad input.

    python scripts/diagnose.py [RECORD ...] [--aircraft FILE] [--hold-out RECORD ...] [--map CHANNEL=COLUMN:unit]
        [--axes full|longitudinal|lateral] [--out DIR] [--seed N] [--quick] [--criteria FILE]
"""

from casid.cli.app import run_as_script

if __name__ == "__main__":
    run_as_script("diagnose")
