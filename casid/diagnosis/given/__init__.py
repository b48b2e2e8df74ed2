"""The simulation as it is given: flown unmodified, what flight contradicts in it, and the budget of its error."""
