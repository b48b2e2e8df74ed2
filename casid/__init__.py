"""Identification of aircraft from flight data."""

import os

# The matrices are small: threads inside the linear algebra cost more than they give. Read once, when numpy is loaded.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
