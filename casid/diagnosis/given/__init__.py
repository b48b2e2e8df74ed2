"""The file as given: its simulation, its values compared with flight, and the budget of its error."""
