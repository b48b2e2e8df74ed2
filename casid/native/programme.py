"""A nonlinear programme for IPOPT on CasADi's virtual machine or, when it pays, on compiled C, with the same numbers.

The functions of a programme differ between data sets by their arguments only, so that one library serves all that have
the same size. When compiling pays is decided as in `compiler`: the time spent without it pays for it.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from typing import Any

import casadi as ca

from casid.native.compiler import c_compiler, cached_library, compile_library

_FUNCTIONS = ("nlp_f", "nlp_g", "nlp_grad_f", "nlp_jac_g", "nlp_hess_l", "nlp_grad")
# the source is long and plain: more optimisation doubles the time of the compiler and gains nothing
_FLAGS = ("-O1", "-march=native", "-fno-math-errno", "-ffp-contract=off", "-shared", "-fPIC")
_LOOK_UP_AFTER = 2.0  # processor s in the virtual machine, after which the source is written for its hash
_COMPILE_PER_BYTE = {"exact": 1.1e-6, "given": 4.2e-6}  # s by the Hessian, measured with gcc on one core


class _Deadline(ca.Callback):
    """Callback of IPOPT after every iteration that stops it at a time. One programme then serves for any time."""

    def __init__(self, nlp: dict[str, ca.MX]) -> None:
        ca.Callback.__init__(self)
        x, g, p = (nlp[name].numel() for name in "xgp")
        # of x, f, g and their multipliers
        self.sizes = (x, 1, g, x, g, p)
        self.until = math.inf
        self.construct("deadline", {})

    def get_n_in(self) -> int:
        return len(self.sizes)

    def get_n_out(self) -> int:
        return 1

    def get_sparsity_in(self, i: int) -> ca.Sparsity:
        return ca.Sparsity.dense(self.sizes[i], 1)

    def eval(self, arguments: Sequence[ca.DM]) -> list[float]:
        return [float(time.perf_counter() > self.until)]


class CompilableProgramme:
    """casadi.nlpsol with IPOPT of a programme `nlp`; `given` are its options that are functions, jac_g or hess_lag, in
    place of CasADi's own. Called with the arguments of nlpsol it returns the result and IPOPT's statistics; `until` of
    `time.perf_counter` it stops."""

    def __init__(self, nlp: dict[str, ca.MX], options: dict[str, Any], given: dict[str, ca.Function]) -> None:
        self._deadline = _Deadline(nlp)
        self._options = options | {"iteration_callback": self._deadline}
        self._given = {option: function.name() for option, function in given.items()}
        self._solver = ca.nlpsol("estimation", "ipopt", nlp, self._options | given)
        self._spent = 0.0
        self._settled = False
        self._source = ""

    def __call__(self, until: float, **arguments: Any) -> tuple[dict[str, ca.DM], dict[str, Any]]:
        self._deadline.until = until
        if not self._settled and self._spent >= _LOOK_UP_AFTER:
            self._compile()
        begin = time.process_time()  # what else runs must not make the compiler look cheap
        result = self._solver(**arguments)
        self._spent += time.process_time() - begin
        return result, self._solver.stats()

    def _compile(self) -> None:
        """Go over to the library when it is there or has been paid for."""
        if c_compiler() is None:
            self._settled = True
            return
        self._source = self._source or self._written()
        library = cached_library(self._source, _FLAGS)
        hessian = "given" if "hess_lag" in self._given else "exact"
        if library is None and self._spent < _COMPILE_PER_BYTE[hessian] * len(self._source):
            return
        library = library or compile_library(self._source, _FLAGS)
        if library is not None:
            more = {option: ca.external(name, str(library)) for option, name in self._given.items()}
            self._solver = ca.nlpsol("estimation", "ipopt", str(library), self._options | more)
        self._settled = True
        self._source = ""

    def _written(self) -> str:
        generator = ca.CodeGenerator("programme.c")
        generator.add(self._solver.oracle())
        for name in _FUNCTIONS:
            generator.add(self._solver.get_function(name))
        return generator.dump()
