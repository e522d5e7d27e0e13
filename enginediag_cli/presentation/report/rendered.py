"""A page as the bytes of its file: with plots that move where the library is there and wanted, else with pictures."""

from __future__ import annotations

from enginediag_cli.presentation.charts.interactive import available, plot, script, version
from enginediag_cli.presentation.report.html import html
from enginediag_cli.presentation.report.page import Page
from enginediag_cli.presentation.report.script import page_script


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
