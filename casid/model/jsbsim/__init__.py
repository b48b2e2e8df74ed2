"""Aircraft of JSBSim: its XML files as simulations, read and written."""

from casid.model.jsbsim.aerodynamics import JsbsimAerodynamics
from casid.model.jsbsim.aircraft import aerodynamics_of, fields_of_jsbsim
from casid.model.jsbsim.write import extended_text

__all__ = ["JsbsimAerodynamics", "aerodynamics_of", "extended_text", "fields_of_jsbsim"]
