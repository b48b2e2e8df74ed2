"""AIAA S-119 (DAVE-ML), the exchange standard of flight models: aircraft read, and their tables corrected."""
