"""Aircraft of JSBSim: its XML files as simulations, read and written."""

from casid.model.jsbsim.aerodynamics import JsbsimAerodynamics
from casid.model.jsbsim.aircraft import aerodynamics_of, fields_of_jsbsim

__all__ = ["JsbsimAerodynamics", "aerodynamics_of", "fields_of_jsbsim"]
