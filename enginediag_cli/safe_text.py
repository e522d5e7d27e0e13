"""Text from files, made harmless for terminals and spreadsheets.

A terminal obeys escape sequences, and a spreadsheet executes cells that begin like a formula.
"""

from __future__ import annotations

import re

_UNSEEN = (
    "\x00-\x08\x0b-\x1f\x7f-\x9f"  # C0 but tab and line end, DEL, C1
    "\u061c\u200e\u200f\u202a-\u202e\u2066-\u2069"  # marks of the direction of writing, of every script (Unicode TR 9)
    "\u2028\u2029"  # ends of lines and paragraphs
    "\u00ad\u034f\u115f\u1160\u17b4\u17b5\u180b-\u180f\u200b-\u200d\u2060-\u2065\u206a-\u206f\u3164\ufe00-\ufe0f"
    "\ufeff\uffa0\ufff0-\ufffb\U0001d173-\U0001d17a\U000e0000-\U000e0fff"  # what has no width (default ignorable)
    "\ud800-\udfff"  # halves of characters: bytes of a name that are no UTF-8
)
"""Characters that cannot be seen, or change how others are seen."""

_CONTROL = re.compile(f"[{_UNSEEN}]")
_CONTROL_OR_BREAK = re.compile(f"[{_UNSEEN}\t\n]")

_FORMULA = re.compile(r"'*[=+\-@\t\r＝＋－＠﹦﹢﹣﹫]")
"""What a spreadsheet takes for a formula, behind any apostrophes, also in full-width and small forms, which some turn
into the plain ones: OWASP, "CSV injection"."""

UNSPEAKABLE = "backslashreplace"
"""What an encoder does with a byte of a file's name that is not UTF-8: text of strangers ends no run."""

SHORT = 80
"""Characters of a text from a file that are repeated in a message."""


def visible(text: str, *, breaks: bool = False) -> str:
    r"""`text` with control characters as escapes that can be read, such as \x1b; with `breaks` also tabs and line
    ends, for a text that must stay in its cell."""
    return (_CONTROL_OR_BREAK if breaks else _CONTROL).sub(lambda found: _escape(found.group()), text)


def json_escaped(text: str) -> str:
    r"""JSON text with control characters as its own escapes (\u202e, or two for one), so that it is the same JSON;
    a byte of a name that is not UTF-8 becomes the text \udce9: as an escape it would be half a character."""
    import json

    def escape(found: re.Match[str]) -> str:
        character = found.group()
        lone = "\ud800" <= character <= "\udfff"
        return "\\" + _escape(character) if lone else json.dumps(character)[1:-1]

    return _CONTROL.sub(escape, text)


def shortened(text: str, most: int = SHORT) -> str:
    """`text`, cut with "…" behind its first `most` characters."""
    return text if len(text) <= most else text[:most] + "…"


def guarded(text: str) -> str:
    """`text` as a CSV cell that a spreadsheet shows and does not run: with an apostrophe before it where it begins
    with = + - @ (of any width), tab or carriage return and is no number. `unguarded` gives the text back."""
    if not _FORMULA.match(text) or text == "-" or _is_number(text):
        return text
    return "'" + text


def unguarded(text: str) -> str:
    """The text of a cell that `guarded` has written."""
    return text[1:] if text.startswith("'") and _FORMULA.match(text) else text


def _escape(character: str) -> str:
    code = ord(character)
    known = {"\t": r"\t", "\n": r"\n"}
    return known.get(character) or (
        f"\\x{code:02x}" if code < 0x100 else f"\\u{code:04x}" if code < 0x10000 else f"\\U{code:08x}"
    )


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return text[:1] not in "\t\r"
