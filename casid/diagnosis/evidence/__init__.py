"""The linearised innovations: fingerprints of causes, small terms, histories at ports."""
