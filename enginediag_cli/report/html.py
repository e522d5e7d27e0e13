"""A page: what a report says, as sections of sentences, facts, tables and charts, and the same as HTML.

Every text that came from a file is escaped here and nowhere else; scripts are named by their hashes, so that no other
one runs, and nothing may be fetched. The style (page.css) is light or dark as the reader's system asks, for a phone and
for paper. The script (page.js) lets the plotting library draw charts that have come into view in place of their
pictures, and filters long tables; without it the page reads as well.
"""

from __future__ import annotations

import base64
import gzip
import hashlib
import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from html import escape
from importlib.resources import files
from textwrap import wrap
from typing import Any, TypeAlias

from enginediag_cli.parameters import Parameter
from enginediag_cli.report.plotting import (
    QUIET,
    SURFACE,
    Chart,
    ChartColumn,
    ChartTable,
    RowOrigin,
    Value,
    format_value,
    pairs,
)
from enginediag_cli.report.plotting.interactive import available, plot, script, version
from enginediag_cli.report.plotting.svg import MARGIN, TITLE, WIDTH, Drawing, Letters, picture
from enginediag_cli.report.sentences import listed
from enginediag_cli.safe_text import visible
from enginediag_cli.units import split_column


class EngineState(Enum):
    """What is known of an engine; the worst first, which is the order in which they are shown."""

    CHANGED = "changed"
    CANNOT_TELL = "cannot tell"
    NO_VERDICT = "no verdict"
    NOTHING_FOUND = "no change found"


@dataclass(frozen=True)
class Paragraph:
    """A paragraph."""

    text: str
    quiet: bool = False


@dataclass(frozen=True)
class Bullets:
    """Sentences that belong together."""

    items: Sequence[str]


@dataclass(frozen=True)
class Preformatted:
    """Lines as they were typed or written: commands, provenance; behind a `title` they are closed at first."""

    lines: Sequence[str]
    title: str = ""


@dataclass(frozen=True)
class TableBlock:
    """A table of its own, shown openly, or closed behind its title; stacked: a phone shows each row as a card."""

    title: str
    table: ChartTable
    closed: bool = False
    stacked: bool = False


@dataclass(frozen=True)
class Folded:
    """Blocks that are closed behind their title at first, and not printed then."""

    title: str
    blocks: Sequence[Block]


Block: TypeAlias = Paragraph | Bullets | Preformatted | TableBlock | Folded | Chart


@dataclass(frozen=True)
class Lead:
    """The first screen, of one engine: which, what is so, how surely, since when, how far it is from its limit, which
    deltas are beyond alert levels, what would have been seen, what to do next, the sensitivity of the conclusion;
    `badge`: the state in other words."""

    state: EngineState
    sentence: str
    engine: str = ""
    identity: str = ""
    confidence: str = ""
    onset: str = ""
    margin: str = ""
    alerts: str = ""
    power: str = ""
    next_step: str = ""
    sensitivity: Sequence[str] = ()
    alternatives: Sequence[str] = ()
    badge: str = ""
    key: str = ""

    @property
    def facts(self) -> list[tuple[str, str]]:
        """What is known beside the sentence, each with its name."""
        named = {
            "How surely": self.confidence,
            "Since": self.onset,
            "Margin": self.margin,
            "Alerts": self.alerts,
            "Would have shown": self.power,
            "What to do next": self.next_step,
        }
        return [(name, text) for name, text in named.items() if text]


def next_step(state: EngineState, changed: Sequence[Parameter], telling: Sequence[str], advice: Sequence[str]) -> str:
    """changed: parameters of the answer, or its suspects; telling: sensors that would separate them; advice: what
    `isolate --advise` said."""
    return " ".join([_own_step(state, changed, telling), *advice])


def _own_step(state: EngineState, changed: Sequence[Parameter], telling: Sequence[str]) -> str:
    instruments = _parts(p for p in changed if p.belongs_to_instrument)
    components = _parts(p for p in changed if not p.belongs_to_instrument)
    if state is EngineState.NO_VERDICT:
        return "Fix the problems below and rerun, or record under conditions that identification covered."
    if state is EngineState.NOTHING_FOUND:
        return "Nothing; keep recording. `detect --detectable` shows the smallest change that each window would show."
    if state is EngineState.CANNOT_TELL:
        if telling:
            sensors = [split_column(column)[0] for column in telling]
            return f"Record {listed(sensors, 'or')}, which separates the suspects; until then do no work on either."
        if instruments:
            return f"Check {listed(instruments)} first: cheaper than opening the engine, and it decides between them."
        return "Record more flights. `isolate --advise` names what separates the suspects best."
    if instruments and not components:
        return f"Check {listed(instruments)}, wiring and recorder channel; the engine itself shows no change."
    if instruments:
        return f"Check {listed(instruments)} first, then inspect the {listed(components)}."
    if components:
        return f"Inspect the {listed(components)}; compare the trend with the log of events since it began."
    return "Ask `isolate` or `trend` what changed."


def _parts(parameters: Iterable[Parameter]) -> list[str]:
    return list(
        dict.fromkeys(("the " if p.belongs_to_instrument else "") + (p.part or p.component) for p in parameters)
    )


@dataclass(frozen=True)
class PageSection:
    """Blocks below a heading; `key` is its anchor."""

    key: str
    title: str
    blocks: Sequence[Block]
    sections: Sequence[PageSection] = ()


@dataclass(frozen=True)
class Page:
    """All of it."""

    title: str
    leads: Sequence[Lead]
    sections: Sequence[PageSection]

    def charts(self) -> list[Chart]:
        """In the order of the page."""
        return [chart for section in self.sections for chart in _charts(section)]


def _charts(section: PageSection) -> list[Chart]:
    blocks = [b for block in section.blocks for b in (block.blocks if isinstance(block, Folded) else [block])]
    own = [block for block in blocks if isinstance(block, Chart)]
    return own + [chart for inner in section.sections for chart in _charts(inner)]


def _read_asset(name: str) -> str:
    """A file that lies beside this one."""
    return (files("enginediag_cli.report") / name).read_text(encoding="utf-8").strip()


def style() -> str:
    """The sheet of a page, with the colours of its pictures in the dark."""
    rules = "".join(
        f'.drawn svg[{what}="{light}"],.drawn svg [{what}="{light}"]{{{what}:{dark}}}'
        for light, dark in pairs()
        for what in ("fill", "stroke")
    )
    return f"{_read_asset('page.css')}\n@media screen and (prefers-color-scheme:dark){{{rules}}}\n"


CLASSES = {
    EngineState.CHANGED: "changed",
    EngineState.CANNOT_TELL: "cannot",
    EngineState.NO_VERDICT: "silent",
    EngineState.NOTHING_FOUND: "fine",
}
MOST_CARDS = 12
"""Engines with a first screen of their own; of more the table of all comes first."""
MOST_OPEN = 20
"""Rows of a table that are all shown; more are scrolled."""
LONG = 60
"""Letters from which a cell may be broken into lines."""


def html(page: Page, script: str = "", plots: Mapping[str, Any] | None = None, library: str = "") -> str:
    """The whole file. script: runs when it is open; plots: by a chart's key, what it is drawn from with the `library`,
    which is packed and unpacked by the script."""
    return "".join(_page(page, script, plots or {}, library))


def escape_text(text: str) -> str:
    """Text as HTML, with control characters as escapes that can be read."""
    return escape(visible(text), quote=True)


def _page(page: Page, script: str, plots: Mapping[str, Any], library: str) -> Iterator[str]:
    hashes = " ".join(f"'sha256-{_hash(text)}'" for text in (library, script) if text) or "'none'"
    policy = f"default-src 'none'; style-src 'unsafe-inline'; img-src data:; script-src {hashes}; base-uri 'none'"
    yield (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f'<meta http-equiv="Content-Security-Policy" content="{policy}">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{escape_text(page.title)}</title>\n<style>\n{style()}</style>\n</head>\n<body>\n"
        '<a class="skip" href="#content">Skip to the charts</a>\n<header>\n'
        f"<h1>{escape_text(page.title)}</h1>\n"
    )
    for lead in page.leads[:MOST_CARDS]:
        yield _lead(lead)
    if len(page.leads) > MOST_CARDS:
        yield f'<p class="quiet">The {MOST_CARDS} worst of {len(page.leads)} engines; the others follow below.</p>\n'
    links = "".join(f'<li><a href="#{escape_text(s.key)}">{escape_text(s.title)}</a></li>' for s in page.sections)
    yield f'<nav aria-label="Contents"><ul>{links}</ul></nav>\n</header>\n<main id="content">\n'
    for section in page.sections:
        yield from _section(section, 2, plots)
    yield "</main>\n"
    if library:
        packed = base64.b64encode(gzip.compress(library.encode(), mtime=0)).decode()
        yield f'<script type="application/gzip" id="library">{packed}</script>\n'
    if script:
        yield f"<script>{script}</script>\n"
    yield "</body>\n</html>\n"


def _lead(lead: Lead) -> str:
    rows = "".join(f"<dt>{name}</dt><dd>{escape_text(text)}</dd>" for name, text in lead.facts)
    for word, lines in (("Alternatives", lead.alternatives), ("Sensitivity of the conclusion", lead.sensitivity)):
        if lines:
            rows += f"<dt>{word}</dt><dd>{_first_line(lines)}</dd>"
    name = f"Engine {escape_text(lead.engine)}: " if lead.engine else ""
    link = f' <a href="#{escape_text(lead.key)}">Charts</a>' if lead.key else ""
    identity = f'<p class="identity">{escape_text(lead.identity)}</p>\n' if lead.identity else ""
    label = f"Verdict{' on engine ' + escape_text(lead.engine) if name else ''}"
    return (
        f'<section class="lead {CLASSES[lead.state]}" aria-label="{label}">'
        f'<div class="state">{name}{escape_text(lead.badge or lead.state.value)}</div>\n'
        f'{identity}<p class="verdict">{escape_text(lead.sentence)}</p>\n<dl>{rows}</dl>{link}</section>\n'
    )


def _first_line(lines: Sequence[str]) -> str:
    """The first of some sentences, the others closed behind their number."""
    first, *more = map(escape_text, lines)
    if not more:
        return first
    return f"{first}<details><summary>{len(more)} more</summary>{'<br>'.join(more)}</details>"


INKS = {
    EngineState.CHANGED: "#b23c00",
    EngineState.CANNOT_TELL: "#7a5b00",
    EngineState.NO_VERDICT: QUIET,
    EngineState.NOTHING_FOUND: "#0b6b34",
}
"""Colours of the states in a picture: those of page.css on white."""
FACT_LEFT, CARD_LETTERS, FACT_LETTERS, CARD_LINE = 140.0, 72, 92, 18.0
"""Pixels before a fact, letters of a line of the verdict and of a fact, and pixels of a line, in a picture."""


def first_screen(page: Page) -> Drawing:
    """The first verdict of a page and its first chart as one drawing, for a document or a message."""
    lead = page.leads[0]
    name = f"engine {lead.engine}: " if lead.engine else ""
    sentence = wrap(lead.sentence, CARD_LETTERS)
    identity = wrap(lead.identity, FACT_LETTERS + 15)
    facts = [(word, wrap(text, FACT_LETTERS)) for word, text in lead.facts]
    lines = 2.5 + len(identity) + len(sentence) * 1.25 + sum(len(text) + 0.25 for _, text in facts)
    card = lines * CARD_LINE
    chart = next(iter(page.charts()), None)
    below = picture(chart) if chart is not None else None
    on = Drawing(WIDTH, card + (below.height if below else 0.0), f"{page.title}: {lead.sentence}")
    on.rectangle(0, 0, WIDTH, card - 8, SURFACE)
    on.rectangle(0, 0, 6, card - 8, INKS[lead.state])
    y = 24.0
    on.words(MARGIN + 6, y, f"{name}{lead.badge or lead.state.value}", letters=Letters(12.0, True, INKS[lead.state]))
    for line in identity:
        y += CARD_LINE
        on.words(MARGIN + 6, y, line, letters=Letters(12.0, fill=QUIET))
    for line in sentence:
        y += CARD_LINE * 1.25
        on.words(MARGIN + 6, y, line, letters=TITLE)
    for word, text in facts:
        y += CARD_LINE * 0.25
        for number, line in enumerate(text):
            y += CARD_LINE
            if not number:
                on.words(MARGIN + 6, y, word, letters=Letters(12.0, fill=QUIET))
            on.words(FACT_LEFT, y, line)
    if below is not None:
        on.add_drawing(below, card)
    return on


def _section(section: PageSection, level: int, plots: Mapping[str, Any]) -> Iterator[str]:
    key = escape_text(section.key)
    yield f'<section aria-labelledby="{key}">\n<h{level} id="{key}">{escape_text(section.title)}</h{level}>\n'
    for block in section.blocks:
        yield from _block(block, plots)
    for inner in section.sections:
        yield from _section(inner, min(level + 1, 4), plots)
    yield "</section>\n"


def _block(block: Block, plots: Mapping[str, Any]) -> Iterator[str]:
    if isinstance(block, Paragraph):
        quiet = ' class="quiet"' if block.quiet else ""
        yield f"<p{quiet}>{escape_text(block.text)}</p>\n"
    elif isinstance(block, Bullets):
        yield f"<ul>{''.join(f'<li>{escape_text(item)}</li>' for item in block.items)}</ul>\n"
    elif isinstance(block, Preformatted):
        lines = "\n".join(map(escape_text, block.lines))
        text = f'<pre tabindex="0">{lines}</pre>\n'
        yield f"<details><summary>{escape_text(block.title)}</summary>{text}</details>\n" if block.title else text
    elif isinstance(block, TableBlock):
        yield from _tabled(block)
    elif isinstance(block, Folded):
        yield f'<details class="folded"><summary>{escape_text(block.title)}</summary>\n'
        for inner in block.blocks:
            yield from _block(inner, plots)
        yield "</details>\n"
    else:
        yield from _chart(block, plots.get(block.key))


def _tabled(block: TableBlock) -> Iterator[str]:
    if block.closed:
        yield f"<details><summary>{escape_text(block.title)}</summary>"
        yield from _table(block.table, block.title, open_=False)
        yield "</details>\n"
    else:
        yield from _table(block.table, block.title, open_=len(block.table.rows) <= MOST_OPEN, stacked=block.stacked)


def _chart(chart: Chart, plot: Any) -> Iterator[str]:
    key = escape_text(chart.key)
    told = f"<span>{escape_text(chart.caption)}</span>" if chart.caption else ""
    thinned = f"<span>{escape_text(chart.thinned)}</span>" if chart.thinned else ""
    yield f'<figure id="{key}" aria-labelledby="{key}-t">\n'
    yield f'<figcaption id="{key}-t"><strong>{escape_text(chart.title)}</strong>{told}{thinned}</figcaption>\n'
    svg = visible(picture(chart, titled=False).text()).strip()
    yield f'<div class="drawn" tabindex="0" role="group" aria-label="{escape_text(chart.title)}: picture">{svg}</div>\n'
    if plot is not None:
        text = json.dumps(plot, ensure_ascii=False, separators=(",", ":"), allow_nan=False)
        yield f'<div class="live" hidden></div>\n<script type="application/json" class="plot">{_inert(text)}</script>\n'
    count = len(chart.table.rows)
    yield f"<details><summary>Table: {escape_text(chart.title)} ({count:,} row{'' if count == 1 else 's'})</summary>"
    yield from _table(chart.table, chart.title, open_=False)
    yield "</details>\n</figure>\n"


def _inert(text: str) -> str:
    """JSON inside a page: nothing in it ends the element or begins a comment."""
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


def _table(table: ChartTable, title: str, *, open_: bool, stacked: bool = False) -> Iterator[str]:
    """With the line of each row's origin; the file is said once where there is one."""
    table = _drop_empty_columns(table)
    sources = list(dict.fromkeys(origin.file for origin in table.origins))
    numeric = [_is_numeric(column, [row[k] for row in table.rows]) for k, column in enumerate(table.columns)]
    head = "".join(
        f"<th scope=col{' class=n' if n else ''}>{escape_text(column.words)}"
        for column, n in zip(table.columns, numeric, strict=True)
    )
    place = "line" if all(o.row.isdigit() for o in table.origins) else "place"
    if table.origins:
        head += ("<th scope=col>file" if len(sources) > 1 else "") + f"<th scope=col>{place}"
    name = f"{escape_text(title)}{f', from {escape_text(sources[0])}' if len(sources) == 1 and sources[0] else ''}"
    kind = f"scroll{' open' if open_ else ''}{' stacked' if stacked else ''}"
    names = [escape_text(column.words) for column in table.columns] if stacked else [""] * len(table.columns)
    yield f'<div class="{kind}" tabindex="0" role="region" aria-label="{name}">'
    yield f"<table><caption class=quiet>{name}</caption><thead><tr>{head}</thead><tbody>\n"
    origins: Sequence[RowOrigin | None] = table.origins or [None] * len(table.rows)
    for row, origin in zip(table.rows, origins, strict=True):
        cells = "".join(_cell(value, n, name) for value, n, name in zip(row, numeric, names, strict=True))
        if origin is not None:
            cells += (f"<td>{escape_text(origin.file)}" if len(sources) > 1 else "") + f"<td>{escape_text(origin.row)}"
        yield f"<tr>{cells}\n"
    yield "</tbody></table></div>"


def _drop_empty_columns(table: ChartTable) -> ChartTable:
    """Without the columns in which no row has anything."""
    kept = [k for k in range(len(table.columns)) if not table.rows or any(format_value(row[k]) for row in table.rows)]
    if len(kept) == len(table.columns):
        return table
    return ChartTable([table.columns[k] for k in kept], [[row[k] for k in kept] for row in table.rows], table.origins)


def _cell(value: Value, numeric: bool, column: str) -> str:
    """column: its name, where each row may stand as a card."""
    text = escape_text(format_value(value))
    if column:
        return f'<td data-label="{column}">{text}'
    kind = " class=n" if numeric else " class=w" if len(text) > LONG else ""
    return f"<td{kind}>{text}"


def _is_numeric(column: ChartColumn, values: Sequence[Value]) -> bool:
    return any(isinstance(v, int | float) for v in values) and not any(isinstance(v, str) for v in values)


def _hash(script: str) -> str:
    return base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()


MOVING_LONG = 15
"""Rows from which a table has a filter."""


def page_script() -> str:
    """The same for every page."""
    return _read_asset("page.js").replace("COLOURS", json.dumps(pairs())).replace("LONG", str(MOVING_LONG)) + "\n"


def plots_can_move() -> bool:
    """Whether plots can move here."""
    return available()


def versions(static: bool) -> list[str]:
    """Of what else decides the bytes."""
    return [] if static or not available() else [version()]


def rendered(page: Page, static: bool = False) -> str:
    """The text of the file."""
    plots = {} if static or not available() else {chart.key: plot(chart) for chart in page.charts() if chart.layers}
    return html(page, page_script(), plots, script() if plots else "")
