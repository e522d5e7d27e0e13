"""The kinds of results that a report reads, each told by what it holds and never by the name of its file."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from typing import Any

from enginediag_cli.residuals.flat import is_flat


@dataclass(frozen=True)
class Kind:
    """`name`: what an error and a list of files call it; `columns`: those of a table that make it this kind; `keys`:
    of a JSON document; `also`: a further condition on its columns."""

    name: str
    command: str
    columns: frozenset[str] = frozenset()
    keys: frozenset[str] = frozenset()
    also: Callable[[Collection[str]], bool] | None = None

    def is_table(self, columns: Collection[str]) -> bool:
        return bool(self.columns) and self.columns <= set(columns) and (self.also is None or self.also(columns))

    def is_document(self, document: Mapping[str, Any]) -> bool:
        return bool(self.keys) and self.keys <= set(document)


def _kind(name: str, command: str, columns: str, also: Callable[[Collection[str]], bool] | None = None) -> Kind:
    return Kind(name, command, frozenset(columns.split()), also=also)


def _of_records(columns: Collection[str]) -> bool:
    return any(column.endswith(SIGMAS) for column in columns)


SIGMAS, RESIDUAL = ":sigmas", ":residual"
"""What `residual --what records` puts behind a sensor's column."""

STATISTICS = _kind("statistics", "residual", "source n chi2 dof", is_flat)
RECORDS = _kind("residuals of records", "residual --what records", "source line state", _of_records)
ISOLATED = _kind("isolated parameters", "isolate", "verdict isolated parameter inclusion change lower upper rivals")
COMPONENTS = _kind("isolated components", "isolate --by component", "verdict components inclusion fit_before records")
TREND = _kind("trend", "trend", "parameter kind onset change change_low change_high verdict")
EVENTS = _kind("trend by component", "trend --by component", "components kind onset onset_flight flights")
FLIGHTS = _kind("health of each flight", "trend --what flights", "parameter number change low high unit")
MARGIN = _kind("margin", "trend --what margin", "row limit_K used_K margin_K remaining_flights recovered_K")
FOLLOWED = _kind("evidence as records came", "detect --follow", "log10_e block alarm")
DETECTED = _kind("verdicts", "detect", "verdict statistic threshold p_value alarm")
LOCATED = _kind("places of a mismatch", "locate", "driver location statistic share stability")
EXPLAINED = Kind("explanation", "explain", keys=frozenset({"explanations", "rejected", "places", "sentences"}))
REFINED = Kind("refinement", "refine --report", keys=frozenset({"verdict", "criteria", "chi2_per_reading", "effects"}))
FLEET = Kind("fleet", "fleet", keys=frozenset({"engines", "discoveries", "left_out"}))
NOMINAL = Kind("nominal engine", "identify")
RECORDING = Kind("recording", "simulate")

TABLES = (STATISTICS, RECORDS, ISOLATED, COMPONENTS, TREND, EVENTS, FLIGHTS, MARGIN, FOLLOWED, DETECTED, LOCATED)
DOCUMENTS = (FLEET, EXPLAINED, REFINED)


def of_table(columns: Collection[str]) -> Kind | None:
    """The kind of a table with these columns; None for none that is known."""
    return next((kind for kind in TABLES if kind.is_table(columns)), None)


def of_document(document: Mapping[str, Any]) -> Kind | None:
    return next((kind for kind in DOCUMENTS if kind.is_document(document)), None)
