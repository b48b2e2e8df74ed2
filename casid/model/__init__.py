"""Models: the aircraft file, its vocabulary, and the symbolic system made of it."""

from casid.model import causes  # fills the register, which a pickled effect needs
