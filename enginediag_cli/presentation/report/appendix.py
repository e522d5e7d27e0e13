"""The end of a report: what was left out, and everything that is needed to make the page again."""

from __future__ import annotations

from collections.abc import Sequence

from enginediag_cli.presentation.charts.model import Column, Origin, Table
from enginediag_cli.presentation.charts.rows import Row
from enginediag_cli.presentation.names import listed
from enginediag_cli.presentation.report.evidence import EngineEvidence, Evidence
from enginediag_cli.presentation.report.page import Block, Bullets, Listing, Section, Tabled, Words
from enginediag_cli.presentation.report.results import kinds

COUNTS = (("outside", "outside what identification covered"), ("incomplete", "incomplete"), ("failed", "not computed"))


def left_out_section(evidence: Evidence, told: Sequence[str]) -> Section:
    """Windows without verdict and records that were not judged, of all engines; `told`: what only a run knows."""
    cells: list[tuple[str | int, ...]] = []
    origins: list[Origin] = []
    for engine in evidence.engines.values():
        for row in _windows(engine):
            lost = {name: row.count(name) for name, _ in COUNTS}
            silent = row.count("sensors_of") - row.count("sensors")
            if not any(lost.values()) and not silent and not row.text("reason"):
                continue
            cells.append((row.window, engine.engine, row.count("records"), *lost.values(), silent, row.text("reason")))
            origins.append(row.origin)
    blocks: list[Block] = [Bullets(told)] if told else []
    columns = (
        Column("window"),
        Column("engine"),
        Column("records"),
        *(Column(words) for _, words in COUNTS),
        Column("sensors silent"),
        Column("why no verdict"),
    )
    if cells:
        blocks.append(Tabled("Records and windows not judged", Table(columns, cells, origins)))
    elif any(_windows(engine) for engine in evidence.engines.values()):
        blocks.append(Words("Every record of every window was judged, by all sensors of the engine."))
    else:
        blocks.append(Words("These results do not say how many records they rest on."))
    if not told:
        blocks.append(
            Words(
                "Readings that were masked are told on standard error by the command that read the recording; a report "
                "made from recordings (-n NOMINAL) lists them here.",
                quiet=True,
            )
        )
    return Section("left-out", "What was left out, and why", blocks)


def _windows(engine: EngineEvidence) -> list[Row]:
    return engine.of(kinds.DETECTED) or [rows[0] for rows in engine.isolated] or engine.of(kinds.COMPONENTS)


def made_section(evidence: Evidence, command: Sequence[str], versions: Sequence[str]) -> Section:
    """The command, what it read, and what that was made by."""
    files = Table(
        (Column("file"), Column("is"), Column("written by"), Column("rows"), Column("SHA-256")),
        [
            (r.name, r.kind.name, f"enginediag {r.kind.command}", len(r.rows), r.sha256 or "of standard input")
            for r in evidence.results
        ],
    )
    blocks: list[Block] = [
        Words("The same files and the same command give this page byte for byte:"),
        Listing(command),
        Listing(versions),
        Tabled("Files", files),
    ]
    for result in evidence.results:
        if result.provenance:
            blocks.append(Listing(result.provenance, f"What {result.name} says of its making"))
    silent = [result.name for result in evidence.results if not result.provenance]
    if silent:
        blocks.append(
            Words(f"{listed(silent)}: no word of what made it; CSV written with its header says so.", quiet=True)
        )
    return Section("made", "How this page was made", blocks)
