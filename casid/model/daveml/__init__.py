"""Aircraft of AIAA S-119 (DAVE-ML), the exchange standard of flight models, as simulations."""

from casid.model.daveml.aircraft import DaveAerodynamics, dave_aerodynamics, fields_of_daveml
from casid.model.daveml.write import mended_text

__all__ = ["DaveAerodynamics", "dave_aerodynamics", "fields_of_daveml", "mended_text"]
