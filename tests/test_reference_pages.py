"""The reference pages are what the program makes of its own declarations."""

from __future__ import annotations

import pytest
from reference import COMMAND, PAGES, is_current


@pytest.mark.parametrize("page", list(PAGES))
def test_a_reference_page_is_current(page: str) -> None:
    assert is_current(page), f"{PAGES[page][0]} is out of date: {COMMAND}"
