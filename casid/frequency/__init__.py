"""Frequency responses of flights and models, coherence, and estimation in the frequency domain."""
