"""Threads inside the linear algebra: none, for on small matrices they cost more than they give.

Their number is read once, when numpy is loaded. Where that was before casid, there are such threads, and they would
fight over the processors with those of casid.
"""

import os
import sys

THREADED_LINEAR_ALGEBRA = "numpy" in sys.modules and os.environ.get("OPENBLAS_NUM_THREADS") != "1"
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
