"""Packed numbers are the numbers, to the last bit, and a damaged text is told."""

from __future__ import annotations

import numpy as np
import pytest

from enginediag_cli.identification.nominal_file import pack_numbers, unpack_numbers


def test_what_is_packed_comes_back_to_the_last_bit():
    numbers = np.concatenate([np.random.default_rng(0).standard_normal(997), [0.0, -0.0, 5e-324, 1e300, np.pi]])
    again = unpack_numbers(pack_numbers(numbers))
    assert again.tobytes() == numbers.tobytes()
    assert max(map(len, pack_numbers(numbers).splitlines())) <= 100
    assert unpack_numbers(pack_numbers(np.empty(0))).shape == (0,)


@pytest.mark.parametrize(
    ("text", "told"),
    [("no base64!", "not base64"), ("AAAA", "3 bytes"), (pack_numbers(np.array([1.0, np.nan])), "not finite")],
)
def test_a_damaged_text_is_told(text, told):
    with pytest.raises(ValueError, match=told):
        unpack_numbers(text)
