"""Ways in which a file goes wrong: by hand, by a program, on the way. Each takes a text and a random generator."""

from __future__ import annotations

import re
from collections.abc import Callable

import numpy as np

Damage = Callable[[str, np.random.Generator], "str | bytes"]

NUMBERS = (
    "0",
    "-1",
    "1e308",
    "-1e308",
    "1e-308",
    "nan",
    ".nan",
    "inf",
    "-.inf",
    "1e30",
    "0x10",
    "1_000",
    "1,5",
    "--3",
    "9" * 400,
)
TEXTS = (
    "",
    "abc",
    "~",
    "true",
    "[]",
    "[1, 2]",
    "{}",
    "{a: 1}",
    "'",
    '"',
    "!!python/object:os.system x",
    "&a *a",
    "- -",
    "#",
    "T4_K",
)
PATHS = (
    "/dev/zero",
    "/dev/stdin",
    "/proc/self/environ",
    "/etc/hostname",
    "../secret.txt",
    ".",
    "..",
    "no-such-file",
    "engine.yaml",
    "https://example.org/x.yaml",
    "a\\0b",
)
"""Where a file could lead; `../secret.txt` holds what must never be told."""
ODD = ("\x00", "\x1b[31m", "\u202e", "\ufeff", "é", "𝟙", "\t", "\r", "\u2028", "＝", "°C")
NUMBER = re.compile(r"(?<![\w.])-?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?(?![\w.])")
KEY = re.compile(r"[A-Za-z_][A-Za-z_0-9.]*(?=:)")


def _lines(text: str) -> list[str]:
    return text.split("\n")


def _pick(rng: np.random.Generator, values: tuple[str, ...]) -> str:
    return values[int(rng.integers(len(values)))]


def _somewhere(text: str, rng: np.random.Generator) -> int:
    return int(rng.integers(len(text) + 1))


def line_lost(text: str, rng: np.random.Generator) -> str:
    lines = _lines(text)
    del lines[int(rng.integers(len(lines)))]
    return "\n".join(lines)


def line_twice(text: str, rng: np.random.Generator) -> str:
    lines = _lines(text)
    k = int(rng.integers(len(lines)))
    return "\n".join([*lines[: k + 1], *lines[k:]])


def lines_shuffled(text: str, rng: np.random.Generator) -> str:
    lines = _lines(text)
    first = int(rng.integers(len(lines)))
    part = lines[first : first + 8]
    rng.shuffle(part)
    return "\n".join([*lines[:first], *part, *lines[first + 8 :]])


def cut_short(text: str, rng: np.random.Generator) -> str:
    return text[: _somewhere(text, rng)]


def emptied(text: str, rng: np.random.Generator) -> str:
    return _pick(rng, ("", "\n", "#\n", " ", "\ufeff"))


def number_replaced(text: str, rng: np.random.Generator) -> str:
    found = list(NUMBER.finditer(text))
    if not found:
        return text
    one = found[int(rng.integers(len(found)))]
    return text[: one.start()] + _pick(rng, NUMBERS) + text[one.end() :]


def number_scaled(text: str, rng: np.random.Generator) -> str:
    found = list(NUMBER.finditer(text))
    if not found:
        return text
    one = found[int(rng.integers(len(found)))]
    value = float(one[0]) * float(rng.choice([-1.0, 1e3, 1e-3, 1e6, 1e-9, 1.7]))
    return text[: one.start()] + repr(value) + text[one.end() :]


def number_to_text(text: str, rng: np.random.Generator) -> str:
    found = list(NUMBER.finditer(text))
    if not found:
        return text
    one = found[int(rng.integers(len(found)))]
    return text[: one.start()] + _pick(rng, TEXTS) + text[one.end() :]


def key_renamed(text: str, rng: np.random.Generator) -> str:
    found = list(KEY.finditer(text))
    if not found:
        return text
    one = found[int(rng.integers(len(found)))]
    k = int(rng.integers(len(one[0])))
    new = _pick(rng, (one[0][:k] + one[0][k + 1 :], one[0] + "x", one[0].upper(), "zz", found[0][0]))
    return text[: one.start()] + new + text[one.end() :]


def word_swapped(text: str, rng: np.random.Generator) -> str:
    """One word of the file in the place of another: a name that exists elsewhere, a unit that is another's."""
    found = list(re.finditer(r"[A-Za-z_][\w.]*", text))
    if len(found) < 2:
        return text
    one, other = (found[int(k)] for k in rng.integers(len(found), size=2))
    return text[: one.start()] + other[0] + text[one.end() :]


def path_led_astray(text: str, rng: np.random.Generator) -> str:
    """A file's name, or any other value, that leads to a device, a folder, or a file that is nobody's business."""
    path = '"' + _pick(rng, PATHS) + '"'
    if "  map: {" in text and rng.random() < 0.6:
        return re.sub(r"  map: \{[^}]*\}", lambda _: f"  map: {{table: {{file: {path}}}}}", text, count=1)
    found = list(re.finditer(r"(?<=: )[^\s{\[,]+", text))
    if not found:
        return text
    files = [one for one in found if one[0].strip("'\"").endswith(".yaml")] or found
    one = files[int(rng.integers(len(files)))]
    return text[: one.start()] + path + text[one.end() :]


def odd_character(text: str, rng: np.random.Generator) -> str:
    k = _somewhere(text, rng)
    return text[:k] + _pick(rng, ODD) + text[k:]


def huge_field(text: str, rng: np.random.Generator) -> str:
    k = _somewhere(text, rng)
    return text[:k] + _pick(rng, ("a", "9", '"', ",", " ")) * 150_000 + text[k:]


def nested(text: str, rng: np.random.Generator) -> str:
    k = _somewhere(text, rng)
    return text[:k] + "[" * int(rng.integers(2, 3000)) + text[k:]


def indented(text: str, rng: np.random.Generator) -> str:
    lines = _lines(text)
    k = int(rng.integers(len(lines)))
    lines[k] = _pick(rng, ("  ", " ", "\t", "      ")) + lines[k]
    return "\n".join(lines)


def bytes_changed(text: str, rng: np.random.Generator) -> bytes:
    raw = bytearray(text.encode())
    for _ in range(int(rng.integers(1, 6))):
        if raw:
            raw[int(rng.integers(len(raw)))] = int(rng.integers(256))
    return bytes(raw)


def bytes_lost(text: str, rng: np.random.Generator) -> bytes:
    raw = text.encode()
    k = int(rng.integers(len(raw) + 1))
    return raw[:k] + raw[k + int(rng.integers(1, 200)) :]


def not_text(text: str, rng: np.random.Generator) -> bytes:
    return bytes(rng.integers(256, size=int(rng.integers(1, 3000)), dtype=np.uint8))


def in_utf_16(text: str, rng: np.random.Generator) -> bytes:
    return text.encode(_codec(rng))


def _codec(rng: np.random.Generator) -> str:
    return _pick(rng, ("utf-16", "utf-16-le", "utf-32"))


ANYWHERE: tuple[Damage, ...] = (
    line_lost,
    line_twice,
    lines_shuffled,
    cut_short,
    emptied,
    number_replaced,
    number_scaled,
    number_to_text,
    word_swapped,
    odd_character,
    huge_field,
    bytes_changed,
    bytes_lost,
    not_text,
    in_utf_16,
)
YAML: tuple[Damage, ...] = (
    *ANYWHERE,
    key_renamed,
    key_renamed,
    nested,
    indented,
    number_replaced,
    number_scaled,
    path_led_astray,
)


def _table(text: str) -> tuple[list[str], list[list[str]]]:
    """The `#` lines, and the cells of header and rows; no file here quotes anything."""
    lines = [line for line in _lines(text) if line]
    return [x for x in lines if x.startswith("#")], [x.split(",") for x in lines if not x.startswith("#")]


def _joined(head: list[str], cells: list[list[str]]) -> str:
    return "\n".join([*head, *(",".join(row) for row in cells)]) + "\n"


def column_lost(text: str, rng: np.random.Generator) -> str:
    head, cells = _table(text)
    k = int(rng.integers(len(cells[0])))
    return _joined(head, [row[:k] + row[k + 1 :] for row in cells])


def column_twice(text: str, rng: np.random.Generator) -> str:
    head, cells = _table(text)
    k = int(rng.integers(len(cells[0])))
    return _joined(head, [[*row, row[k]] for row in cells])


def column_renamed(text: str, rng: np.random.Generator) -> str:
    head, cells = _table(text)
    k = int(rng.integers(len(cells[0])))
    name = cells[0][k]
    cells[0][k] = _pick(rng, (name.lower(), name + "_degF", name.rsplit("_", 1)[0], "", "flight", "engine", name[:-1]))
    return _joined(head, cells)


def column_replaced(text: str, rng: np.random.Generator) -> str:
    head, cells = _table(text)
    k, value = int(rng.integers(len(cells[0]))), _pick(rng, (*NUMBERS, "", "NaN", "-9999"))
    for row in cells[1:]:
        row[k] = value
    return _joined(head, cells)


def column_scaled(text: str, rng: np.random.Generator) -> str:
    """Another unit than the header says."""
    head, cells = _table(text)
    k, factor = int(rng.integers(len(cells[0]))), float(rng.choice([1e3, 1e-3, 6894.757, 0.5, -1.0]))
    for row in cells[1:]:
        try:
            row[k] = repr(float(row[k]) * factor - float(rng.choice([0.0, 273.15])))
        except ValueError:
            continue
    return _joined(head, cells)


def columns_emptied(text: str, rng: np.random.Generator) -> str:
    head, cells = _table(text)
    for k in rng.choice(len(cells[0]), size=int(rng.integers(1, len(cells[0]))), replace=False):
        for row in cells[1:]:
            row[int(k)] = ""
    return _joined(head, cells)


def cells_replaced(text: str, rng: np.random.Generator) -> str:
    head, cells = _table(text)
    for _ in range(int(rng.integers(1, 20))):
        if len(cells) > 1:
            row = cells[int(rng.integers(1, len(cells)))]
            row[int(rng.integers(len(row)))] = _pick(rng, (*NUMBERS, "", "", "-9999"))
    return _joined(head, cells)


def cells_huge(text: str, rng: np.random.Generator) -> str:
    """Numbers at the end of what a float holds, of either sign, in one column or in all."""
    head, cells = _table(text)
    chosen = range(len(cells[0])) if rng.random() < 0.2 else [int(rng.integers(len(cells[0])))]
    for row in cells[1:]:
        for k in chosen:
            if k < len(row) and rng.random() < 0.5:
                row[k] = _pick(rng, ("1e308", "-1e308", "1.7e308", "-1.7976931348623157e308", "1e154", "-1e200"))
    return _joined(head, cells)


def stands_still(text: str, rng: np.random.Generator) -> str:
    """A recorder that repeats one record from somewhere on, with a clock that goes on."""
    head, cells = _table(text)
    if len(cells) < 3 or "time_s" not in cells[0]:
        return text
    time, first = cells[0].index("time_s"), int(rng.integers(1, len(cells)))
    for row in cells[first + 1 :]:
        if time < len(row):
            row[:] = [row[time] if k == time else cell for k, cell in enumerate(cells[first])]
    return _joined(head, cells)


def frozen(text: str, rng: np.random.Generator) -> str:
    head, cells = _table(text)
    return _joined(head, [cells[0], *([cells[1]] * (len(cells) - 1))]) if len(cells) > 1 else text


def header_alone(text: str, rng: np.random.Generator) -> str:
    head, cells = _table(text)
    return _joined(head, cells[:1])


def rows_shuffled(text: str, rng: np.random.Generator) -> str:
    head, cells = _table(text)
    rows = cells[1:]
    rng.shuffle(rows)
    return _joined(head, [cells[0], *rows])


def twice(text: str, rng: np.random.Generator) -> str:
    return text + text


def ragged(text: str, rng: np.random.Generator) -> str:
    head, cells = _table(text)
    row = cells[int(rng.integers(len(cells)))]
    row[:] = row[:-1] if rng.random() < 0.5 else [*row, "1"]
    return _joined(head, cells)


def quoted(text: str, rng: np.random.Generator) -> str:
    k = _somewhere(text, rng)
    return text[:k] + '"' + text[k:]


def other_line_ends(text: str, rng: np.random.Generator) -> str:
    return text.replace("\n", _pick(rng, ("\r\n", "\r", "\n\n")))


TABLE: tuple[Damage, ...] = (
    *ANYWHERE,
    column_lost,
    column_twice,
    column_renamed,
    column_replaced,
    column_replaced,
    column_scaled,
    columns_emptied,
    cells_replaced,
    cells_replaced,
    cells_huge,
    stands_still,
    frozen,
    header_alone,
    rows_shuffled,
    twice,
    ragged,
    quoted,
    other_line_ends,
)
