"""CasADi SX functions as C on vectors: one lane per segment, in the vector extension of gcc and clang.

The instruction list of a function becomes straight-line code on values of type V. Arithmetic is the compiler's own;
sin and its like come from the vector library of glibc where there is one; everything else is a loop over lanes.
"""

from __future__ import annotations

import casadi as ca
import numpy as np
from scipy.special import erf

from casid.native.sources import c_source

# operation of CasADi -> its C of operands a and b, and what `tape` does with arrays of them
ARITHMETIC = {
    ca.OP_ASSIGN: ("{a}", lambda a: a),
    ca.OP_ADD: ("{a} + {b}", np.add),
    ca.OP_SUB: ("{a} - {b}", np.subtract),
    ca.OP_MUL: ("{a} * {b}", np.multiply),
    ca.OP_DIV: ("{a} / {b}", np.divide),
    ca.OP_NEG: ("-{a}", np.negative),
    ca.OP_SQ: ("{a} * {a}", np.square),
    ca.OP_TWICE: ("{a} + {a}", lambda a: a + a),
    ca.OP_INV: ("1.0 / {a}", lambda a: np.divide(1.0, a)),
}
# operation -> the function of math.h and of numpy that has this name
LIBRARY = {
    ca.OP_SIN: "sin",
    ca.OP_COS: "cos",
    ca.OP_EXP: "exp",
    ca.OP_LOG: "log",
    ca.OP_TAN: "tan",
    ca.OP_ASIN: "asin",
    ca.OP_ACOS: "acos",
    ca.OP_ATAN: "atan",
    ca.OP_TANH: "tanh",
    ca.OP_SINH: "sinh",
    ca.OP_COSH: "cosh",
}
LIBRARY_OF_TWO = {ca.OP_ATAN2: "atan2", ca.OP_POW: "pow", ca.OP_CONSTPOW: "pow"}
BY_LANE = {
    ca.OP_SQRT: ("sqrt(a)", np.sqrt),
    ca.OP_FABS: ("fabs(a)", np.abs),
    ca.OP_FLOOR: ("floor(a)", np.floor),
    ca.OP_CEIL: ("ceil(a)", np.ceil),
    ca.OP_FMOD: ("fmod(a, b)", np.fmod),
    ca.OP_FMIN: ("fmin(a, b)", np.fmin),
    ca.OP_FMAX: ("fmax(a, b)", np.fmax),
    ca.OP_COPYSIGN: ("copysign(a, b)", np.copysign),
    ca.OP_SIGN: ("(a > 0) - (a < 0)", np.sign),
    ca.OP_ERF: ("erf(a)", erf),
    ca.OP_ASINH: ("asinh(a)", np.arcsinh),
    ca.OP_ACOSH: ("acosh(a)", np.arccosh),
    ca.OP_ATANH: ("atanh(a)", np.arctanh),
    ca.OP_HYPOT: ("hypot(a, b)", np.hypot),
    ca.OP_LOG1P: ("log1p(a)", np.log1p),
    ca.OP_EXPM1: ("expm1(a)", np.expm1),
    ca.OP_LT: ("a < b", lambda a, b: 1.0 * (a < b)),
    ca.OP_LE: ("a <= b", lambda a, b: 1.0 * (a <= b)),
    ca.OP_EQ: ("a == b", lambda a, b: 1.0 * (a == b)),
    ca.OP_NE: ("a != b", lambda a, b: 1.0 * (a != b)),
    ca.OP_NOT: ("!a", lambda a: 1.0 * (a == 0.0)),
    ca.OP_AND: ("a && b", lambda a, b: 1.0 * ((a != 0.0) & (b != 0.0))),
    ca.OP_OR: ("a || b", lambda a, b: 1.0 * ((a != 0.0) | (b != 0.0))),
    ca.OP_IF_ELSE_ZERO: ("a ? b : 0.0", lambda a, b: np.where(a != 0.0, b, 0.0)),
}
_SINCE_GLIBC_2_22 = ("sin", "cos", "exp", "log")


class UnknownOperationError(Exception):
    """A function contains what this emitter has no C for."""


def prelude() -> str:
    """The vector type V of W lanes, and the functions that emitted code calls."""
    first = [f"VECTOR1({name})" for name in _SINCE_GLIBC_2_22]
    later = [f"LATER1({name})" for name in LIBRARY.values() if name not in _SINCE_GLIBC_2_22]
    two = [f"LATER2({name})" for name in sorted(set(LIBRARY_OF_TWO.values()))]
    lanes = []
    for op, (expression, _) in BY_LANE.items():
        body = f"for (int i = 0; i < W; i++) {{ double a = x[i], b = y[i]; (void)b; r[i] = {expression}; }}"
        lanes.append(f"static inline V lane_{op}(V x, V y) {{ V r; {body} return r; }}")
    return "\n".join([c_source("vectors"), *first, *later, *two, *lanes])


def emit(function: ca.Function, name: str) -> str:
    """C of `static inline void name(const V *a0, ..., V *r0, ...)`; arguments and results are the nonzeros in CasADi's
    order. Raises UnknownOperationError."""
    arguments = [f"const V *restrict a{i}" for i in range(function.n_in())]
    results = [f"V *restrict r{i}" for i in range(function.n_out())]
    lines = [f"static inline void {name}({', '.join(arguments + results)})", "{"]
    lines.append("V " + ", ".join(f"w{i}" for i in range(max(function.sz_w(), 1))) + ";")
    lines += [_statement(function, k) for k in range(function.n_instructions())]
    return "\n".join([*lines, "}"])


def _statement(function: ca.Function, k: int) -> str:
    op = function.instruction_id(k)
    to = function.instruction_output(k)
    of = function.instruction_input(k)
    if op == ca.OP_OUTPUT:
        return f"r{to[0]}[{to[1]}] = w{of[0]};"
    if op == ca.OP_INPUT:
        return f"w{to[0]} = a{of[0]}[{of[1]}];"
    if op == ca.OP_CONST:
        return f"w{to[0]} = (V){{0}} + {_number(function.instruction_constant(k))};"
    a = f"w{of[0]}"
    b = f"w{of[-1]}"
    if op in ARITHMETIC:
        return f"w{to[0]} = {ARITHMETIC[op][0].format(a=a, b=b)};"
    if op in LIBRARY:
        return f"w{to[0]} = v_{LIBRARY[op]}({a});"
    if op in LIBRARY_OF_TWO:
        return f"w{to[0]} = v_{LIBRARY_OF_TWO[op]}({a}, {b});"
    if op in BY_LANE:
        return f"w{to[0]} = lane_{op}({a}, {b});"
    if op == ca.OP_CALL:
        raise UnknownOperationError("it calls a function of CasADi or of Python")
    names = {getattr(ca, name): name for name in dir(ca) if name.startswith("OP_")}
    raise UnknownOperationError(f"it contains CasADi's {names.get(op, op)}")


def _number(value: float) -> str:
    special = {"inf": "INFINITY", "-inf": "-INFINITY", "nan": "NAN"}
    return special.get(repr(float(value)), repr(float(value)))
