"""Where the public recordings lie (ENGINEDIAG_SHARED, or the folder `shared` beside the checkout), and one made up."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

REPOSITORY = Path(__file__).resolve().parents[2]
RECORDERS = REPOSITORY / "configs" / "recorders"


def shared_data(relative: str) -> Path:
    """Path of a public data file; skips the test with a message when it is not there."""
    root = Path(os.environ.get("ENGINEDIAG_SHARED") or REPOSITORY.parent / "shared")
    path = root / "data" / relative
    if not path.exists():
        pytest.skip(f"public recording data/{relative} is absent (ENGINEDIAG_SHARED: the folder of data/)")
    return path


def flight(n: int = 20_000, seed: int = 1) -> dict[str, np.ndarray]:
    """Five sensors that follow power, which holds, steps and ramps; white Gaussian noise."""
    rng = np.random.default_rng(seed)
    power = np.interp(np.arange(n), np.arange(0, n + 1, 400), rng.uniform(0.4, 1.0, n // 400 + 1))
    power[n // 2 :] = np.repeat(rng.uniform(0.4, 1.0, n // 200 + 1), 200)[: n - n // 2]
    gains = {
        "N1_rpm": (8000, 15),
        "T3_K": (400, 1.0),
        "P3_Pa": (2e6, 4e3),
        "Wf_kg_s": (1.0, 0.004),
        "ITT_K": (700, 2),
    }
    return {name: gain * (0.5 + power) + noise * rng.normal(size=n) for name, (gain, noise) in gains.items()}
