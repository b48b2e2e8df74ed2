"""The linearised innovations: fingerprints of causes, model discrepancy, latent inputs at ports."""
