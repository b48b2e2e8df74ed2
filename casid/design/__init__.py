"""Input design: the most informative manoeuvre about the parameters."""

from casid.design.experiment import Experiment
from casid.design.input_design import InputDesign, design_input, standard_3211
from casid.design.input_shapes import Multisine, StepInput
