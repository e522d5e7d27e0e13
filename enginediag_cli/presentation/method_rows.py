"""What a rival method says of windows, as rows: its tests, its alarm, and what it names."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from enginediag_cli.residuals.flat import window_row

if TYPE_CHECKING:
    from enginediag_cli.methods.base import Method
    from enginediag_cli.methods.on_recordings import WindowVerdict

TEST_COLUMNS = ("statistic", "threshold", "p_value")


def method_row(found: WindowVerdict, method: Method) -> dict[str, Any]:
    """One row: the window, `<test>:statistic`, `:threshold` and `:p_value` of each test, `alarm`, `isolated` with the
    kind of name that it is, the probability that the method states, verdict and reason. A window without a verdict
    has empty cells where its tests would stand.
    """
    row = window_row(found.window.place)
    row.update(judged=found.window.judged, method=method.name)
    verdicts, w = found.verdicts, found.number
    values = {test.name: test for test in verdicts.tests} if verdicts is not None and not found.reason else {}
    for name in method.tests:
        for column in TEST_COLUMNS:
            row[f"{name}:{column}"] = getattr(values[name], column)[w] if name in values else None
    told = verdicts is not None and not found.reason
    named = verdicts.isolated_names(w) if verdicts is not None and told else None
    row.update(
        alarm=bool(verdicts.alarm[w]) if verdicts is not None and told else None,
        isolated=list(named or ()),
        isolated_kind=verdicts.kind if verdicts is not None and named else None,
        probability=_probability(found) if named else None,
        verdict=found.verdict,
        reason=found.reason,
    )
    return row


def _probability(found: WindowVerdict) -> float | None:
    verdicts = found.verdicts
    return None if verdicts is None or verdicts.probability is None else float(verdicts.probability[found.number])
