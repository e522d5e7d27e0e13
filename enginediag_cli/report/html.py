"""A page: what a report says, as sections of sentences, facts, tables and charts, and the same as HTML.

Every text that came from a file is escaped here and nowhere else; scripts are named by their hashes, so that no other
one runs, and nothing may be fetched. The style (page.css) is light or dark as the reader's system asks, for a phone and
for paper. The script (page.js) lets the plotting library draw charts that have come into view in place of their
pictures, and filters long tables; without it the page reads as well.
"""

from __future__ import annotations

import base64
import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from html import escape
from importlib.resources import files
from typing import Any, TypeAlias

from enginediag_cli.report.plotting import Chart, Column, Origin, Table, Value, pairs, shown
from enginediag_cli.report.plotting.interactive import available, plot, script, version
from enginediag_cli.report.plotting.svg import picture
from enginediag_cli.safe_text import visible


class State(Enum):
    """What is known of an engine; the worst first, which is the order in which they are shown."""

    CHANGED = "changed"
    CANNOT_TELL = "cannot tell"
    NO_VERDICT = "no verdict"
    NOTHING_FOUND = "nothing found"


@dataclass(frozen=True)
class Words:
    """A paragraph."""

    text: str
    quiet: bool = False


@dataclass(frozen=True)
class Bullets:
    """Sentences that belong together."""

    items: Sequence[str]


@dataclass(frozen=True)
class Listing:
    """Lines as they were typed or written: commands, provenance; behind a `title` they are closed at first."""

    lines: Sequence[str]
    title: str = ""


@dataclass(frozen=True)
class Tabled:
    """A table of its own, shown openly, or closed behind its title."""

    title: str
    table: Table
    closed: bool = False


Block: TypeAlias = Words | Bullets | Listing | Tabled | Chart


@dataclass(frozen=True)
class Lead:
    """The first screen, of one engine: what is so, how surely, since when, how far it is from its limit, what to do
    next, what would flip it; `badge`: the state in other words."""

    state: State
    sentence: str
    engine: str = ""
    surely: str = ""
    since: str = ""
    margin: str = ""
    next: str = ""
    flips: Sequence[str] = ()
    rivals: Sequence[str] = ()
    badge: str = ""
    key: str = ""


@dataclass(frozen=True)
class Section:
    """Blocks below a heading; `key` is its anchor."""

    key: str
    title: str
    blocks: Sequence[Block]
    sections: Sequence[Section] = ()


@dataclass(frozen=True)
class Page:
    """All of it."""

    title: str
    leads: Sequence[Lead]
    sections: Sequence[Section]

    def charts(self) -> list[Chart]:
        """In the order of the page."""
        return [chart for section in self.sections for chart in _charts(section)]


def _charts(section: Section) -> list[Chart]:
    own = [block for block in section.blocks if isinstance(block, Chart)]
    return own + [chart for inner in section.sections for chart in _charts(inner)]


def _text_of(name: str) -> str:
    """A file that lies beside this one."""
    return (files("enginediag_cli.report") / name).read_text(encoding="utf-8").strip()


def style() -> str:
    """The sheet of a page, with the colours of its pictures in the dark."""
    rules = "".join(
        f'.drawn svg[{what}="{light}"],.drawn svg [{what}="{light}"]{{{what}:{dark}}}'
        for light, dark in pairs()
        for what in ("fill", "stroke")
    )
    return f"{_text_of('page.css')}\n@media screen and (prefers-color-scheme:dark){{{rules}}}\n"


CLASSES = {
    State.CHANGED: "changed",
    State.CANNOT_TELL: "cannot",
    State.NO_VERDICT: "silent",
    State.NOTHING_FOUND: "fine",
}
MOST_CARDS = 12
"""Engines with a first screen of their own; of more the table of all comes first."""
MOST_OPEN = 20
"""Rows of a table that are all shown; more are scrolled."""
LONG = 60
"""Letters from which a cell may be broken into lines."""


def html(page: Page, scripts: Sequence[str] = (), plots: Mapping[str, Any] | None = None) -> str:
    """The whole file. scripts: run in this order; plots: by a chart's key, what a script draws it from."""
    return "".join(_page(page, scripts, plots or {}))


def said(text: str) -> str:
    """Text as HTML, with control characters as escapes that can be read."""
    return escape(visible(text), quote=True)


def _page(page: Page, scripts: Sequence[str], plots: Mapping[str, Any]) -> Iterator[str]:
    hashes = " ".join(f"'sha256-{_hash(script)}'" for script in scripts) or "'none'"
    policy = f"default-src 'none'; style-src 'unsafe-inline'; img-src data:; script-src {hashes}; base-uri 'none'"
    yield (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f'<meta http-equiv="Content-Security-Policy" content="{policy}">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{said(page.title)}</title>\n<style>\n{style()}</style>\n</head>\n<body>\n"
        '<a class="skip" href="#content">Skip to the charts</a>\n<header>\n'
        f"<h1>{said(page.title)}</h1>\n"
    )
    for lead in page.leads[:MOST_CARDS]:
        yield _lead(lead)
    if len(page.leads) > MOST_CARDS:
        yield f'<p class="quiet">The {MOST_CARDS} worst of {len(page.leads)} engines; the others stand below.</p>\n'
    links = "".join(f'<li><a href="#{said(s.key)}">{said(s.title)}</a></li>' for s in page.sections)
    yield f'<nav aria-label="Contents"><ul>{links}</ul></nav>\n</header>\n<main id="content">\n'
    for section in page.sections:
        yield from _section(section, 2, plots)
    yield "</main>\n"
    for text in scripts:
        yield f"<script>{text}</script>\n"
    yield "</body>\n</html>\n"


def _lead(lead: Lead) -> str:
    facts = [
        ("How surely", lead.surely),
        ("Since", lead.since),
        ("Margin", lead.margin),
        ("What to do next", lead.next),
    ]
    rows = "".join(f"<dt>{name}</dt><dd>{said(text)}</dd>" for name, text in facts if text)
    for word, lines in (("What would flip it", lead.flips), ("Not excluded either", lead.rivals)):
        if lines:
            rows += f"<dt>{word}</dt><dd>{'<br>'.join(map(said, lines))}</dd>"
    name = f"Engine {said(lead.engine)}: " if lead.engine else ""
    link = f' <a href="#{said(lead.key)}">Charts</a>' if lead.key else ""
    label = f"Verdict{' on engine ' + said(lead.engine) if name else ''}"
    return (
        f'<section class="lead {CLASSES[lead.state]}" aria-label="{label}">'
        f'<div class="state">{name}{said(lead.badge or lead.state.value)}</div>\n'
        f'<p class="verdict">{said(lead.sentence)}</p>\n<dl>{rows}</dl>{link}</section>\n'
    )


def _section(section: Section, level: int, plots: Mapping[str, Any]) -> Iterator[str]:
    key = said(section.key)
    yield f'<section aria-labelledby="{key}">\n<h{level} id="{key}">{said(section.title)}</h{level}>\n'
    for block in section.blocks:
        yield from _block(block, plots)
    for inner in section.sections:
        yield from _section(inner, min(level + 1, 4), plots)
    yield "</section>\n"


def _block(block: Block, plots: Mapping[str, Any]) -> Iterator[str]:
    if isinstance(block, Words):
        quiet = ' class="quiet"' if block.quiet else ""
        yield f"<p{quiet}>{said(block.text)}</p>\n"
    elif isinstance(block, Bullets):
        yield f"<ul>{''.join(f'<li>{said(item)}</li>' for item in block.items)}</ul>\n"
    elif isinstance(block, Listing):
        lines = "\n".join(map(said, block.lines))
        text = f'<pre tabindex="0">{lines}</pre>\n'
        yield f"<details><summary>{said(block.title)}</summary>{text}</details>\n" if block.title else text
    elif isinstance(block, Tabled):
        yield from _tabled(block)
    else:
        yield from _chart(block, plots.get(block.key))


def _tabled(block: Tabled) -> Iterator[str]:
    if block.closed:
        yield f"<details><summary>{said(block.title)}</summary>"
        yield from _table(block.table, block.title, open_=False)
        yield "</details>\n"
    else:
        yield from _table(block.table, block.title, open_=len(block.table.rows) <= MOST_OPEN)


def _chart(chart: Chart, plot: Any) -> Iterator[str]:
    key = said(chart.key)
    told = f"<span>{said(chart.caption)}</span>" if chart.caption else ""
    thinned = f"<span>{said(chart.thinned)}</span>" if chart.thinned else ""
    yield f'<figure id="{key}" aria-labelledby="{key}-t">\n'
    yield f'<figcaption id="{key}-t"><strong>{said(chart.title)}</strong>{told}{thinned}</figcaption>\n'
    svg = visible(picture(chart, titled=False).text()).strip()
    yield f'<div class="drawn" tabindex="0" role="group" aria-label="{said(chart.title)}: picture">{svg}</div>\n'
    if plot is not None:
        text = json.dumps(plot, ensure_ascii=False, separators=(",", ":"), allow_nan=False)
        yield f'<div class="live" hidden></div>\n<script type="application/json" class="plot">{_inert(text)}</script>\n'
    count = len(chart.table.rows)
    yield f"<details><summary>Table: {said(chart.title)} ({count:,} row{'' if count == 1 else 's'})</summary>"
    yield from _table(chart.table, chart.title, open_=False)
    yield "</details>\n</figure>\n"


def _inert(text: str) -> str:
    """JSON inside a page: nothing in it ends the element or begins a comment."""
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


def _table(table: Table, title: str, *, open_: bool) -> Iterator[str]:
    """With the line of each row's origin; the file is said once where there is one."""
    table = _without_empty(table)
    sources = list(dict.fromkeys(origin.file for origin in table.origins))
    numeric = [_is_numeric(column, [row[k] for row in table.rows]) for k, column in enumerate(table.columns)]
    head = "".join(
        f"<th scope=col{' class=n' if n else ''}>{said(column.words)}"
        for column, n in zip(table.columns, numeric, strict=True)
    )
    place = "line" if all(o.row.isdigit() for o in table.origins) else "place"
    if table.origins:
        head += ("<th scope=col>file" if len(sources) > 1 else "") + f"<th scope=col>{place}"
    name = f"{said(title)}{f', from {said(sources[0])}' if len(sources) == 1 and sources[0] else ''}"
    kind = "scroll open" if open_ else "scroll"
    yield f'<div class="{kind}" tabindex="0" role="region" aria-label="{name}">'
    yield f"<table><caption class=quiet>{name}</caption><thead><tr>{head}</thead><tbody>\n"
    origins: Sequence[Origin | None] = table.origins or [None] * len(table.rows)
    for row, origin in zip(table.rows, origins, strict=True):
        cells = "".join(_cell(value, n) for value, n in zip(row, numeric, strict=True))
        if origin is not None:
            cells += (f"<td>{said(origin.file)}" if len(sources) > 1 else "") + f"<td>{said(origin.row)}"
        yield f"<tr>{cells}\n"
    yield "</tbody></table></div>"


def _without_empty(table: Table) -> Table:
    """Without the columns in which no row has anything."""
    kept = [k for k in range(len(table.columns)) if not table.rows or any(shown(row[k]) for row in table.rows)]
    if len(kept) == len(table.columns):
        return table
    return Table([table.columns[k] for k in kept], [[row[k] for k in kept] for row in table.rows], table.origins)


def _cell(value: Value, numeric: bool) -> str:
    text = said(shown(value))
    kind = " class=n" if numeric else " class=w" if len(text) > LONG else ""
    return f"<td{kind}>{text}"


def _is_numeric(column: Column, values: Sequence[Value]) -> bool:
    return any(isinstance(v, int | float) for v in values) and not any(isinstance(v, str) for v in values)


def _hash(script: str) -> str:
    return base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()


MOVING_LONG = 15
"""Rows from which a table has a filter."""


def page_script() -> str:
    """The same for every page."""
    return _text_of("page.js").replace("COLOURS", json.dumps(pairs())).replace("LONG", str(MOVING_LONG)) + "\n"


def moves() -> bool:
    """Whether plots can move here."""
    return available()


def versions(static: bool) -> list[str]:
    """Of what else decides the bytes."""
    return [] if static or not available() else [version()]


def rendered(page: Page, static: bool = False) -> str:
    """The text of the file."""
    if static or not available():
        return html(page, [page_script()])
    return html(page, [script(), page_script()], {chart.key: plot(chart) for chart in page.charts() if chart.layers})
