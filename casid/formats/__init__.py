"""An aircraft in the files of other simulators: what they can hold, and what they cannot, said."""
