"""What a report says, before anybody writes it as HTML: sections of sentences, facts, tables and charts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from typing import TypeAlias

from enginediag_cli.report.charts.model import Chart, Table


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
