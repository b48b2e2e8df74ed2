"""The flight as a diagnosis sees it: records made ready, a hypothesis, its fit."""
