"""Settings of the whole test run."""

from __future__ import annotations

import gc
import os

# the matrices of the tests are small: threads of the linear algebra would only wait for each other
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


def pytest_collection_finish() -> None:
    """What collecting left stays until the end: the search for circles of references need not look at it again."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(20_000, 10, 10)
