"""Packed numbers are the numbers, to the last bit, and a damaged text is told."""

from __future__ import annotations

import numpy as np
import pytest

from enginediag_cli.identification.nominal_file import packed, unpacked


def test_what_is_packed_comes_back_to_the_last_bit():
    numbers = np.concatenate([np.random.default_rng(0).standard_normal(997), [0.0, -0.0, 5e-324, 1e300, np.pi]])
    again = unpacked(packed(numbers))
    assert again.tobytes() == numbers.tobytes()
    assert max(map(len, packed(numbers).splitlines())) <= 100
    assert unpacked(packed(np.empty(0))).shape == (0,)


@pytest.mark.parametrize(
    ("text", "told"),
    [("no base64!", "not base64"), ("AAAA", "3 bytes"), (packed(np.array([1.0, np.nan])), "not finite")],
)
def test_a_damaged_text_is_told(text, told):
    with pytest.raises(ValueError, match=told):
        unpacked(text)
