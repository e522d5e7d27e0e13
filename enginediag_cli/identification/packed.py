"""Many numbers as one text: base64 of little-endian 64-bit floats, in lines. Lossless, and read a hundred times as fast
as a list, of which every number is a node with a place of its own."""

from __future__ import annotations

import base64
import binascii
import textwrap

import numpy as np

LINE = 100
"""Characters of a line: no editor folds it."""


def packed(numbers: np.ndarray) -> str:
    """The text of numbers (n,)."""
    return "\n".join(textwrap.wrap(base64.b64encode(np.asarray(numbers, "<f8").tobytes()).decode(), LINE)) + "\n"


def unpacked(text: str) -> np.ndarray:
    """The numbers (n,) of a text. Raises ValueError for what `packed` did not make, and for what is not finite."""
    try:
        raw = base64.b64decode("".join(text.split()), validate=True)
    except (binascii.Error, ValueError) as error:
        raise ValueError("it is not base64") from error
    if len(raw) % 8:
        raise ValueError(f"it has {len(raw)} bytes, which are no 64-bit numbers")
    numbers = np.frombuffer(raw, "<f8").astype(float)
    if not np.isfinite(numbers).all():
        raise ValueError("it holds a number that is not finite")
    return numbers
