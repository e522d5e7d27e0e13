"""Results in, a page out."""

from __future__ import annotations

from collections.abc import Sequence

from enginediag_cli import __version__
from enginediag_cli.presentation.charts.fleet_found import engines_of
from enginediag_cli.presentation.report.appendix import left_out_section, made_section
from enginediag_cli.presentation.report.engine_sections import engine_section
from enginediag_cli.presentation.report.evidence import Evidence
from enginediag_cli.presentation.report.fleet_sections import fleet_lead, fleet_section
from enginediag_cli.presentation.report.page import Lead, Page, Section, State
from enginediag_cli.presentation.report.physics_sections import physics_leads, physics_sections
from enginediag_cli.presentation.report.results import kinds
from enginediag_cli.presentation.report.verdicts import lead_of

TITLE = "Engine report"
WORST_FIRST = tuple(State)


def page_of(
    evidence: Evidence,
    *,
    title: str = "",
    command: Sequence[str] = (),
    left_out: Sequence[str] = (),
    versions: Sequence[str] = (),
) -> Page:
    """All that the results say. command: what makes the page again; left_out: what only reading the recordings told."""
    leads: list[Lead] = []
    sections: list[Section] = []
    ordered = []
    for number, engine in enumerate(evidence.engines.values(), start=1):
        key = f"engine-{number}"
        ordered.append((lead_of(engine, evidence, key), engine, key))
    ordered.sort(key=lambda entry: WORST_FIRST.index(entry[0].state))
    for lead, engine, key in ordered:
        leads.append(lead)
        sections.append(engine_section(engine, evidence, key))
    leads += physics_leads(evidence)
    for number, result in enumerate(evidence.documents(kinds.FLEET), start=1):
        engines = engines_of(result.document, result.name)
        leads.append(fleet_lead(result.document, engines, f"fleet-{number}"))
        sections.append(fleet_section(result, engines, f"fleet-{number}"))
    sections += physics_sections(evidence)
    sections += [
        left_out_section(evidence, left_out),
        made_section(evidence, command, [f"enginediag {__version__}", *versions]),
    ]
    return Page(title or TITLE, leads, sections)
