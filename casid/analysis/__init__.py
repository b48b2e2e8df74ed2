"""After an estimation: intervals, what the data can tell apart, errors in the inputs."""

from casid.analysis.bootstrap import Bootstrap, bootstrap, collected, drawn_problem, replica
from casid.analysis.identifiability import Identifiability, identifiability
from casid.analysis.input_noise import InputErrors, input_noise_errors, with_noisy_inputs
from casid.analysis.profile import ProfileInterval, profile
