"""The diagnosis of any dynamic system: ports, a library of causes for any model, and complete hypotheses."""
