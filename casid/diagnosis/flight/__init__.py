"""The fit of a hypothesis to flight records: preparation of the records, noise, prior, and fit."""
