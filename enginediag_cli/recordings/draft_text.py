"""A drafted recorder as YAML text with comments."""

from __future__ import annotations

import json
import os

from enginediag_cli.recordings.draft import Draft, Guess
from enginediag_cli.recordings.sniff import Sniffed
from enginediag_cli.recordings.source import DELIMITERS, THOUSANDS

MOST_WORDS = 12
"""Unknown words in columns of numbers that are listed; a file with more is of another kind."""


def draft_yaml(found: Draft, engine: str = "") -> str:
    """The recorder as YAML text; `engine`: the engine file whose columns were sought."""
    name = os.path.basename(found.sniffed.source)
    records = max((len(cells) for cells in found.sniffed.cells.values()), default=0)
    scheme = found.header.scheme
    lines = [
        f"# Recorder drafted from the first {records} records of {_plain(name)}.",
        "# GUESSED: taken from names or values; see that it is so. DECIDE: the file leaves it open.",
        *([f"# Names as in {scheme.name}."] if scheme else []),
        "kind: recorder",
        f"description: {_quoted('recordings like ' + _plain(name))}   # DECIDE: which engine, which recorder",
    ]
    if found.decisions:
        lines += ["", "# Every command repeats these until they are removed from here:", "decide:"]
        lines += [f"  - {_quoted(_plain(text))}" for text in found.decisions]
    lines += ["", *_file(found.sniffed), *_time(found)]
    lines += ["", "columns:" if found.columns else "columns: {}   # DECIDE: no column was recognised"]
    lines += [_column_line(g) for g in found.columns.values()]
    if found.engines:
        lines += ["", "engines:   # GUESSED: speeds or fuel flows come once for each"]
        lines += [f"  {e}: {{prefix: {_quoted(p)}}}" for e, p in found.engines.items()]
    if found.header.texts:
        pairs = ", ".join(f"{target}: {_quoted(source)}" for target, source in found.header.texts.items())
        lines += ["", f"text: {{{pairs}}}   # GUESSED: what names a flight, an engine, a phase"]
    if found.derived:
        lines += ["", "derived:   # GUESSED: computed from what is recorded"]
        lines += [f"  - {{name: {target}, {rule}}}" for target, rule in found.derived.items()]
    if found.missing:
        lines += ["", f"# DECIDE: {_plain(engine)} asks for these, and no column was taken for them:"]
        lines += [f"#   {target}: {_plain(advice)}" for target, advice in found.missing.items()]
        lines += ["# An input that was not recorded may be held: `constants: {humidity_kg_kg: 0}`."]
    if found.unused:
        lines += ["", "# Not used; a text to pass through goes under `keep:`:"]
        lines += [f"#   {_plain(column)}: {_plain(why)}" for column, why in found.unused.items()]
    lines += [
        "",
        "# DECIDE: which records are steady, such as",
        "# steady: {window_s: 10, gap_s: 3, spread: {N1_rpm: 100}, dwell_s: 30, dwell: {N1_rpm: 500}}",
        "# average_s: 10",
    ]
    return "\n".join(lines) + "\n"


def _file(sniffed: Sniffed) -> list[str]:
    dialect = sniffed.dialect
    named = {mark: word for word, mark in DELIMITERS.items()}
    lines = [
        "file:",
        f"  delimiter: {named.get(dialect.delimiter, dialect.delimiter)}",
        f"  decimal: {'comma' if dialect.decimal == ',' else 'point'}",
        f"  encoding: {dialect.encoding}" + ("   # GUESSED: it is not UTF-8" if sniffed.guessed_encoding else ""),
    ]
    if dialect.thousands:
        word = next(word for word, mark in THOUSANDS.items() if mark == dialect.thousands)
        lines.append(f"  thousands: {word}   # GUESSED")
    if dialect.names:
        lines += ["  header: none", f"  names: [{', '.join(map(_quoted, dialect.names))}]"]
        lines[-1] += "   # DECIDE: the file names no columns" if sniffed.invented and dialect.names[0] == "c1" else ""
    lines += [f"  header_line: {dialect.header_line}"] if dialect.header_line else []
    lines += ["  unit_row: true"] if dialect.unit_row else []
    words = _missing_words(sniffed)
    if words:
        lines.append(f"  missing: [{', '.join(map(_quoted, words))}]   # GUESSED: words among numbers")
    if sniffed.long:
        table = sniffed.long
        parts = [f"tag: {_quoted(table.tag)}", f"value: {_quoted(table.value)}"]
        if table.quality:
            parts += [f"quality: {_quoted(table.quality)}", f"good: [{', '.join(map(_quoted, table.good))}]"]
        lines.append(f"  long: {{{', '.join(parts)}}}   # DECIDE: clock, max_age_s: how tags are brought to one time")
    return lines


def _missing_words(sniffed: Sniffed) -> list[str]:
    words: dict[str, int] = {}
    for column in sniffed.header:
        if sniffed.values(column) is not None:
            for word, n in sniffed.words(column).items():
                words[word] = words.get(word, 0) + n
    return sorted(words, key=lambda w: (-words[w], w))[:MOST_WORDS]


def _time(found: Draft) -> list[str]:
    clock = found.clock
    if clock is None or not clock.form:
        return []
    day = (
        "day before month"
        if clock.form.startswith("%d/")
        else "month before day"
        if clock.form.startswith("%m/")
        else ""
    )
    remark = "; ".join(x for x in (day, clock.remark) if x)
    zone = ", zone: UTC" if clock.remark == "UTC" else ""
    text = f"   # GUESSED{': ' + remark if remark else ''}" + (
        "" if zone else "; stamps without a zone are taken for UTC: zone: +01:00"
    )
    text = f"   # DECIDE: {clock.doubt}" if clock.doubt else text
    sources = ", ".join(map(_quoted, clock.sources))
    return ["", f"time: {{from: [{sources}], format: {_quoted(clock.form)}{zone}}}{text}"]


def _column_line(g: Guess) -> str:
    parts = [f"from: {_quoted(g.source)}", f"unit: {_quoted(g.unit)}"]
    parts += [f"scale: {g.scale:.10g}"] if g.scale != 1.0 else []
    parts += [f"offset: {g.offset:g}"] if g.offset else []
    parts += [f"full_scale: {g.full_scale:.8g}"] if g.full_scale is not None else []
    parts += [f"density_kg_m3: {g.density:g}"] if g.density is not None else []
    parts += [f"limits: [{_number(g.limits[0])}, {_number(g.limits[1])}]"] if g.limits else []
    text = (
        f"   # DECIDE: {'; '.join(g.doubts)}"
        if g.doubts
        else f"   # GUESSED: {'; '.join(g.remarks)}"
        if g.remarks
        else ""
    )
    return f"  {g.target}: {{{', '.join(parts)}}}{_plain(text)}"


def _number(value: float) -> str:
    """Three digits suffice for a limit; written without an exponent that YAML would read as text."""
    rounded = float(f"{value:.3g}")
    return f"{rounded:.0f}" if abs(rounded) >= 100.0 else f"{rounded:g}"


def _quoted(text: str) -> str:
    return json.dumps(text, ensure_ascii=False)


def _plain(text: str) -> str:
    """On one line and without control characters, for a comment."""
    return "".join(c if c.isprintable() else "·" for c in text)
