"""Text that comes from files, made harmless: for a terminal, which obeys escape sequences, and for a spreadsheet,
which runs cells that begin like a formula."""

from __future__ import annotations

import re

_UNSEEN = "\x00-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069"
"""C0 but tab and line end, DEL, C1, and the marks that turn the direction of writing (Unicode TR 9)."""

_CONTROL = re.compile(f"[{_UNSEEN}]")
_CONTROL_OR_BREAK = re.compile(f"[{_UNSEEN}\t\n]")

_FORMULA = re.compile(r"'*[=+\-@\t\r]")
"""What a spreadsheet takes for a formula, behind any apostrophes: OWASP, "CSV injection"."""

SHORT = 80
"""Characters of a text from a file that are repeated in a message."""


def visible(text: str, *, breaks: bool = False) -> str:
    r"""`text` with control characters as escapes that can be read, such as \x1b; with `breaks` also tabs and line
    ends, for a text that must stay in its cell."""
    return (_CONTROL_OR_BREAK if breaks else _CONTROL).sub(lambda found: _escape(found.group()), text)


def shortened(text: str, most: int = SHORT) -> str:
    """`text`, cut with "…" behind its first `most` characters."""
    return text if len(text) <= most else text[:most] + "…"


def guarded(text: str) -> str:
    """`text` as a CSV cell that a spreadsheet shows and does not run: with an apostrophe before it where it begins
    with = + - @, tab or carriage return and is no number. `unguarded` gives the text back."""
    if not _FORMULA.match(text) or text == "-" or _is_number(text):
        return text
    return "'" + text


def unguarded(text: str) -> str:
    """The text of a cell that `guarded` has written."""
    return text[1:] if text.startswith("'") and _FORMULA.match(text) else text


def _escape(character: str) -> str:
    code = ord(character)
    known = {"\t": r"\t", "\n": r"\n"}
    return known.get(character) or (f"\\x{code:02x}" if code < 0x100 else f"\\u{code:04x}")


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return text[:1] not in "\t\r"
