"""Outside references of parameter estimation: certified regressions and published optima of differential equations."""
