"""What parameters mean, as far as the results say: an identified engine travels in its nominal file."""

from __future__ import annotations

from collections.abc import Sequence

from enginediag_cli.parameters import Parameter
from enginediag_cli.presentation.report.results import kinds
from enginediag_cli.presentation.report.results.read import Result


def known_of(results: Sequence[Result]) -> dict[str, Parameter]:
    """By name, of every nominal file among the results. Raises ConfigError for a damaged one."""
    from enginediag_cli.intake.baseline import open_baseline
    from enginediag_cli.residuals.monitor import monitor_of

    known: dict[str, Parameter] = {}
    for result in results:
        if result.kind is kinds.NOMINAL:
            known.update(monitor_of(open_baseline(result.path), sensors=True).meaning)
    return known


def nominal_result(path: str) -> Result:
    """The nominal file with which recordings were judged, as one of the files of a report."""
    import os

    from enginediag_cli.recordings.provenance import sha256_of

    return Result(kinds.NOMINAL, os.path.basename(path), sha256=sha256_of(path), path=path)
