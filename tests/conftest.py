"""Settings of the whole test run."""

from __future__ import annotations

import gc
import os

# the matrices of the tests are small: threads of the linear algebra would only wait for each other
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# what collecting makes stays until the end: nothing of it need be looked at for circles of references, then or later
gc.disable()


def pytest_collection_finish() -> None:
    gc.freeze()
    gc.set_threshold(20_000, 10, 10)
    gc.enable()
