"""A recorder YAML drafted from a file's head, for the user to finish: what was guessed, and what is to be decided."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field

import numpy as np

from enginediag_cli.recordings.dialect import DELIMITERS
from enginediag_cli.recordings.quantities import FLIGHT, Guess, guess, target_of, words_of
from enginediag_cli.recordings.sniff import Sniffed, known_unit
from enginediag_cli.recordings.stamps import Stamps
from enginediag_cli.recordings.table import Recording
from enginediag_cli.units import split_header

PAIRS = (("lh", "rh"), ("left", "right"), ("l", "r"), ("eng1", "eng2"), ("e1", "e2"), ("1", "2"))
"""How files name the columns of two engines: a word at the beginning or at the end."""
FORMS = (
    "iso",
    "%d.%m.%Y %H:%M:%S",
    "%d.%m.%Y %H:%M:%S.%f",
    "%d/%m/%Y %H:%M:%S",
    "%m/%d/%Y %H:%M:%S",
    "%Y/%m/%d %H:%M:%S",
    "%d-%b-%Y %H:%M:%S",
    "%H:%M:%S",
    "%H:%M:%S.%f",
)
"""Forms of time stamps that are tried, in this order."""
STAMP_CELLS = 200
"""Cells that must be stamps of a form before a column is taken for one."""


@dataclass
class Draft:
    """What was found. columns: source (with {prefix} where engines have their own) → guess; engines: name → prefix;
    missing: targets asked for that no column gives; unused: columns that were not recognised."""

    sniffed: Sniffed
    columns: dict[str, Guess] = field(default_factory=dict)
    engines: dict[str, str] = field(default_factory=dict)
    time: tuple[tuple[str, ...], str] | None = None
    flight: str = ""
    derived: dict[str, str] = field(default_factory=dict)
    missing: list[str] = field(default_factory=list)
    unused: list[str] = field(default_factory=list)


def draft(sniffed: Sniffed, targets: Collection[str] = ()) -> Draft:
    """Guess what the columns are; `targets`: the inputs and sensors of an engine, the only ones wanted besides what
    others are computed from."""
    result = Draft(sniffed)
    result.time = _stamps(sniffed)
    taken = set(result.time[0]) if result.time else set()
    numbers = {c: v for c in sniffed.header if c not in taken and (v := sniffed.values(c)) is not None}
    own = _engines(list(numbers))
    if own:
        result.engines = own[0]
    first = next(iter(result.engines.values()), "")
    for column, values in numbers.items():
        pattern = own[1].get(column, column) if own else column
        if own and column in own[1] and pattern.replace("{prefix}", first) != column:
            continue  # the same column of the other engine
        quantity, unit = _parted(sniffed, column, pattern)
        found = target_of(quantity, targets)
        made = {g.target for g in result.columns.values()} | ({"time_s"} if result.time else set())
        if found is None or found[0] in made:
            result.unused.append(column)
        else:
            result.columns[pattern] = guess(*found, unit, values)
    text = [c for c in sniffed.header if c not in numbers and c not in taken]
    result.flight = next((c for c in (*text, *result.unused) if FLIGHT.fullmatch(words_of(c))), "")
    result.unused = [c for c in (*result.unused, *text) if c != result.flight]
    _derive(result, targets)
    made = {g.target for g in result.columns.values()} | set(result.derived)
    result.missing = [t for t in targets if t not in made]
    return result


def _parted(sniffed: Sniffed, column: str, pattern: str) -> tuple[str, str]:
    """Quantity and unit of a column, the engine's word left out."""
    quantity, unit = split_header(re.sub(r"[ _.-]?\{prefix\}[ _.-]?", " ", pattern).strip())
    row = sniffed.units[sniffed.header.index(column)].strip(" []()")
    return quantity, unit or (row if row and row != "-" and known_unit(row) else "")


def _engines(columns: Sequence[str]) -> tuple[dict[str, str], dict[str, str]] | None:
    """Engine → prefix, and column → its pattern with {prefix}, for the pair of words that most columns share."""
    best: tuple[dict[str, str], dict[str, str]] | None = None
    for pair in PAIRS:
        patterns: dict[str, str] = {}
        words: dict[str, str] = {}
        for column in columns:
            for k, word in enumerate(pair):
                for place in (rf"^({word})(?=[ _.-])", rf"(?<=[ _.-])({word})(?=$|[ _]?[\[(]|_[A-Za-z]+$)"):
                    hit = re.search(place, column, re.IGNORECASE)
                    if hit and column not in patterns:
                        patterns[column] = column[: hit.start(1)] + "{prefix}" + column[hit.end(1) :]
                        words[column] = f"{k}{hit.group(1)}"
        both = {p: {words[c] for c in patterns if patterns[c] == p} for p in patterns.values()}
        shared = {c: p for c, p in patterns.items() if len({w[0] for w in both[p]}) == 2 and len(both[p]) == 2}
        spelt = sorted({words[c] for c in shared})
        # two columns each are the least that is no chance, and one spelling for each engine
        if len(shared) >= 4 and len(spelt) == 2 and (best is None or len(shared) > len(best[1])):
            names = ("left", "right") if pair[0][0] == "l" else ("engine_1", "engine_2")
            best = (dict(zip(names, (s[1:] for s in spelt), strict=True)), shared)
    return best


def _stamps(sniffed: Sniffed) -> tuple[tuple[str, ...], str] | None:
    """Columns of a time stamp and its form: one column of text, or a date and a time of day."""
    text = [c for c in sniffed.header if sniffed.values(c) is None]
    pairs = [(a, b) for a in text for b in text if re.search("dat", a, re.I) and re.search("time|zeit|uhr", b, re.I)]
    for sources in [(c,) for c in text if re.search("time|zeit|date|datum|utc|stamp", c, re.I)] + [
        p for p in pairs if p[0] != p[1]
    ]:
        cells = {c: [x for x in sniffed.cells[c][:STAMP_CELLS]] for c in sources}
        for form in FORMS:
            # a date alone is a stamp, too, but one that says the same in each record
            try:
                seconds = Stamps(sources, form).seconds(Recording({}, cells))
            except ValueError:
                continue
            if len(seconds) and np.isfinite(seconds).mean() > 0.5 and (np.ptp(seconds[np.isfinite(seconds)]) > 0.0):
                if not (form.startswith("%H") and len(sources) == 1 and any(sources[0] == p[1] for p in pairs)):
                    return sources, form
    return None


def _derive(result: Draft, targets: Collection[str]) -> None:
    """Rules for what is not recorded but follows from what is."""
    made = {g.target for g in result.columns.values()}
    static = "ambient_temperature_K" in made
    if "mach" not in made:
        if "tas_m_s" in made and (static or "TAT_K" in made):
            which = "" if static else ", temperature: TAT_K, total: true"
            result.derived["mach"] = f"rule: mach_from_tas{which}"
        elif {"cas_m_s", "altitude_m"} <= made:
            result.derived["mach"] = "rule: mach_from_cas"
    if not static and "TAT_K" in made and {"mach"} & {*made, *result.derived}:
        result.derived["ambient_temperature_K"] = "rule: static_temperature, total: TAT_K"
    if "altitude_m" in made and {"ambient_temperature_K"} & {*made, *result.derived}:
        if not targets or "dT_isa_K" in targets:
            result.derived["dT_isa_K"] = "rule: isa_deviation"
    if {"relative_humidity", "ambient_pressure_Pa"} <= made and {"ambient_temperature_K"} & {*made, *result.derived}:
        result.derived["humidity_kg_kg"] = "rule: humidity_ratio"


def draft_yaml(found: Draft, engine: str = "") -> str:
    """The recorder as YAML text with comments; `engine`: the engine file whose columns were asked for."""
    name, dialect = os.path.basename(found.sniffed.source), found.sniffed.dialect
    records = len(next(iter(found.sniffed.cells.values()), []))
    lines = [
        f"# Recorder drafted from the first {records} records of {_plain(name)}.",
        "# GUESSED: taken from names or values; see that it is so. DECIDE: nothing in the file says it.",
        "kind: recorder",
        f"description: {_quoted('recordings like ' + _plain(name))}   # DECIDE: which engine, which recorder",
        "",
        "file:",
        f"  delimiter: {next(word for word, mark in DELIMITERS.items() if mark == dialect.delimiter)}",
        f"  decimal: {'comma' if dialect.decimal == ',' else 'point'}",
        f"  encoding: {dialect.encoding}" + ("   # GUESSED: it is not UTF-8" if found.sniffed.guessed_encoding else ""),
    ]
    lines += [f"  header_line: {dialect.header_line}"] if dialect.header_line else []
    lines += ["  unit_row: true"] if dialect.unit_row else []
    if found.time:
        sources, form = found.time
        what = "day before month" if form.startswith("%d/") else "month before day" if form.startswith("%m/") else ""
        told = "   # GUESSED" + (f": {what}" if what else "") + "; DECIDE the zone if stamps do not say: zone: +01:00"
        lines += ["", f"time: {{from: [{', '.join(map(_quoted, sources))}], format: {_quoted(form)}}}{told}"]
    lines += ["", "columns:" if found.columns else "columns: {}   # DECIDE: no column was recognised"]
    lines += [_column_line(source, g) for source, g in found.columns.items()]
    if found.engines:
        lines += ["", "engines:   # GUESSED from the names of the columns"]
        lines += [f"  {e}: {{prefix: {_quoted(p)}}}" for e, p in found.engines.items()]
    if found.flight:
        lines += ["", f"text: {{flight: {_quoted(found.flight)}}}   # GUESSED: records of one flight"]
    if found.derived:
        lines += ["", "derived:   # GUESSED: computed from what is recorded"]
        lines += [f"  - {{name: {target}, {rule}}}" for target, rule in found.derived.items()]
    if found.missing:
        lines += ["", f"# DECIDE: {_plain(engine)} asks for these, and no column was taken for them:"]
        lines += [f"#   {target}" for target in found.missing]
        lines += ["# An input that was not recorded may be held: `constants: {humidity_kg_kg: 0}`."]
    if found.unused:
        lines += ["", "# Not used; a text to pass through goes under `keep:`:"]
        lines += [f"#   {_plain(column)}" for column in found.unused]
    lines += [
        "",
        "# DECIDE: which records are steady, such as",
        "# steady: {window_s: 10, gap_s: 3, spread: {N1_rpm: 100}, dwell_s: 30, dwell: {N1_rpm: 500}}",
        "# average_s: 10",
    ]
    return "\n".join(lines) + "\n"


def _column_line(source: str, g: Guess) -> str:
    parts = [f"from: {_quoted(source)}", f"unit: {_quoted(g.unit)}"]
    parts += [f"full_scale: {g.full_scale:g}"] if g.full_scale is not None else []
    parts += [f"density_kg_m3: {g.density:g}"] if g.density is not None else []
    told = f"   # DECIDE: {g.doubt}" if g.doubt else "" if g.stated else "   # GUESSED"
    return f"  {g.target}: {{{', '.join(parts)}}}{_plain(told)}"


def _quoted(text: str) -> str:
    return json.dumps(text, ensure_ascii=False)


def _plain(text: str) -> str:
    """On one line and without control characters, for a comment."""
    return "".join(c if c.isprintable() else "·" for c in text)
