"""Compiled code: the compiler and its cache, the emitter, C sources, and the processors that run them."""
