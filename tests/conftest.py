"""Settings of the whole test run."""

from __future__ import annotations

import os

# the matrices of the tests are small: threads of the linear algebra would only wait for each other
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
