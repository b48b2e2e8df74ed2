"""Sizes of the kernel of collocation. Truth: the functions that were built, of which no two sizes are alike."""

from __future__ import annotations

import casadi as ca

from casid.native.kernel_source import collocation_sizes


def test_every_size_is_that_of_its_own_function() -> None:
    n, m, q, o, f = 2, 3, 5, 4, 1
    x, u, p = ca.SX.sym("x", n), ca.SX.sym("u", m), ca.SX.sym("p", q)
    rates, read = x * p[0] + u[:n] * p[1], ca.vertcat(x, u[:1], p[4])
    along = [ca.jacobian(rates, x), ca.jacobian(rates, p[0])]
    slopes = ca.Function("slopes", [x, u, p], [rates, *along])
    outputs = ca.Function("outputs_of", [x, u, p], [read, ca.jacobian(read, x), ca.jacobian(read, p[0])])
    found = collocation_sizes({"slopes": slopes, "outputs_of": outputs})
    assert (found.n, found.m, found.q, found.o, found.f) == (n, m, q, o, f)
