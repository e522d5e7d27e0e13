"""What engines of one aircraft get wrong alike counts once."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from test_aircraft import fitted, flown

from enginediag_cli.mismatch.fit.evidence import Flight
from enginediag_cli.mismatch.fit.noise import independent_readings
from enginediag_cli.mismatch.fit.projection import Projection
from enginediag_cli.mismatch.unrecorded.companions import with_shared_errors


def with_common_error(flights, size, seed=5):
    """Each reading wrong by `size` noise standard deviations, by the same at the same time on both engines."""
    wrong: dict[tuple[str, str], np.ndarray] = {}
    found = []
    for f in flights:
        columns = dict(f.columns)
        for c in (c for c in columns if c.startswith(("T", "P", "N2", "Wf"))):
            rng = np.random.default_rng((seed, len(wrong)))
            e = wrong.setdefault((f.file, c), rng.standard_normal(len(f)))
            spread = np.abs(np.diff(columns[c])).min() if size == 0 else 0.003 * np.abs(columns[c]).mean()
            columns[c] = columns[c] + size * spread * e
        found.append(Flight(f.label, f.engine, columns, f.file))
    return found


def test_independent_errors_of_two_engines_stay_two_readings():
    found, _ = fitted(flown(0.0)[0])
    shared = with_shared_errors(Projection(found))
    assert shared is None or max(shared.noise.shared.values()) < 1.5


def test_an_error_that_both_engines_share_is_one_reading():
    found, _ = fitted(with_common_error(flown(0.0)[0], 3.0))
    projection = Projection(found)
    shared = with_shared_errors(projection)
    assert shared is not None
    alike = shared.noise.shared
    assert np.median(list(alike.values())) > 1.7 and max(alike.values()) <= 2.0
    for s, k in alike.items():
        assert shared.noise.sigma[s] == pytest.approx(found.evidence.noise.sigma[s] * np.sqrt(k))
    fewer = Projection(replace(found, evidence=shared))
    assert independent_readings(fewer) < 0.7 * independent_readings(projection)


def test_engines_that_do_not_fly_side_by_side_share_nothing():
    found, _ = fitted([f for f in flown(0.0)[0] if f.engine == "0"])
    assert with_shared_errors(Projection(found)) is None
