"""The diagnosis of any dynamic system: ports, a library of causes for any model, wholes that are refitted."""
