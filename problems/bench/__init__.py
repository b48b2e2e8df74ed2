"""What the benchmarks share, and what they measured."""
