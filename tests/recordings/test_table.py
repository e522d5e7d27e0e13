from __future__ import annotations

import numpy as np
import pytest

from enginediag_cli.errors import DataError
from enginediag_cli.recordings.table import Recording, concat


def recording(n: int = 4, source: str = "a.csv") -> Recording:
    return Recording(
        {"T3_K": np.arange(n, dtype=float)},
        {"engine": [f"e{k}" for k in range(n)]},
        ("engine", "T3_K"),
        np.arange(2, n + 2),
        source,
    )


def test_selecting_rows_keeps_numbers_text_and_lines_together():
    part = recording().select(np.array([False, True, False, True]))
    assert part["T3_K"].tolist() == [1.0, 3.0]
    assert part.text["engine"] == ["e1", "e3"]
    assert part.line.tolist() == [3, 5]
    assert len(recording().select(slice(1, 3))) == 2


def test_added_columns_come_last_and_replaced_ones_keep_their_place():
    r = recording().with_columns({"P3_Pa": np.ones(4), "engine": np.zeros(4)})
    assert r.order == ("engine", "T3_K", "P3_Pa")
    assert "engine" in r and "engine" not in r.text


def test_concatenation_keeps_every_record_and_refuses_other_columns():
    both = concat([recording(2), recording(3, "b.csv")])
    assert len(both) == 5 and both.source == "a.csv + b.csv"
    with pytest.raises(DataError, match="P3_Pa"):
        concat([recording(), recording().with_columns({"P3_Pa": np.ones(4)})])


def test_columns_of_different_lengths_are_refused():
    with pytest.raises(ValueError, match="lengths"):
        Recording({"a": np.zeros(2), "b": np.zeros(3)})
