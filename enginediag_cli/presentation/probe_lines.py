"""Probes that the heat balances contradict, in words."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from enginediag_cli.identification.probe_consistency import WrongProbe
from enginediag_cli.presentation.numbers import rounded
from enginediag_cli.units import split_column


def probe_lines(found: Iterable[WrongProbe], *, kept: bool) -> Iterator[str]:
    """One line for each finding; kept: the readings stay in the fit because the user wants it."""
    for w in found:
        unit = split_column(w.columns[0])[1]
        low, middle, high = (f"{v:+.3g}" for v in w.error)
        numbers = f"by {middle} {unit} ({low} to {high} in 8 of 10 records; ± {rounded(w.expected)} expected)"
        told = f"over {w.records:,} records ({', '.join(w.balances)})"
        if not w.told_apart:
            others = ", ".join(w.columns[1:])
            yield (
                f"heat balances contradict {w.columns[0]} {numbers}, or as well {others}, {told}; which of them "
                "cannot be told, and all stay in the fit"
            )
            continue
        ends = "it stays in the fit (--keep-probes)" if kept else "it is left out of the fit (--keep-probes keeps it)"
        yield f"heat balances contradict {w.columns[0]} {numbers} {told}; {ends}"
