"""Estimate the derivatives of an aircraft file from flight records.

Question     which values explain the measured outputs (output error), the forces and moments (equation error), or both
             (combined, paper eq. 11-15), how certain are they, and how well do they explain each channel?
Set-up       --free names what is estimated, by globs; default: all derivatives and terms that move the axes. Instrument
             biases (bias_q ...) have an own value per record. Effects of the aircraft file act; a symbolic one can be
             freed by its name, e.g. --free 'Cm_*' 'cg_offset(x)'. The a-priori uncertainty of the file is a prior.
             --defects soft takes the forces and moments as noisy; the variances are those of highest likelihood.
Expectation  DIR/estimate.json, DIR/model.toml (the aircraft file with the estimates; biases belong to the records and
             stand in estimate.json alone), DIR/figures, DIR/run.json. Status 0, also without convergence, which
             estimate.json says in words; 2 and one line for bad input.

    python scripts/estimate.py RECORD ... --aircraft FILE [--cost output|equation|combined] [--equation-weight 0.5]
        [--method single|multiple|collocation] [--interval N] [--defects hard|soft]
        [--solver automatic|gauss-newton|ipopt] [--free GLOB ...] [--axes full|longitudinal|lateral]
        [--map CHANNEL=COLUMN:unit] [--out DIR]
"""

from casid.cli.app import run_as_script

if __name__ == "__main__":
    run_as_script("estimate")
