"""The public functions and classes of the library, each where its name says."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from enginediag_cli.api.building_blocks import Description as Description
    from enginediag_cli.api.building_blocks import Listing as Listing
    from enginediag_cli.api.building_blocks import describe_component as describe_component
    from enginediag_cli.api.building_blocks import describe_effect as describe_effect
    from enginediag_cli.api.building_blocks import list_components as list_components
    from enginediag_cli.api.building_blocks import list_effects as list_effects
    from enginediag_cli.api.building_blocks import list_law_variables as list_law_variables
    from enginediag_cli.api.detection import DetectionResult as DetectionResult
    from enginediag_cli.api.detection import FollowResult as FollowResult
    from enginediag_cli.api.detection import MethodResult as MethodResult
    from enginediag_cli.api.detection import ResidualResult as ResidualResult
    from enginediag_cli.api.detection import detect as detect
    from enginediag_cli.api.detection import detect_by_method as detect_by_method
    from enginediag_cli.api.detection import follow as follow
    from enginediag_cli.api.detection import residual as residual
    from enginediag_cli.api.discrepancy import ExplainResult as ExplainResult
    from enginediag_cli.api.discrepancy import LocateResult as LocateResult
    from enginediag_cli.api.discrepancy import PerRecordResult as PerRecordResult
    from enginediag_cli.api.discrepancy import SearchOptions as SearchOptions
    from enginediag_cli.api.discrepancy import effect_names as effect_names
    from enginediag_cli.api.discrepancy import explain as explain
    from enginediag_cli.api.discrepancy import locate as locate
    from enginediag_cli.api.discrepancy import locate_per_record as locate_per_record
    from enginediag_cli.api.files import CheckResult as CheckResult
    from enginediag_cli.api.files import RecorderDraft as RecorderDraft
    from enginediag_cli.api.files import check as check
    from enginediag_cli.api.files import draft_recorder as draft_recorder
    from enginediag_cli.api.fleets import FleetResult as FleetResult
    from enginediag_cli.api.fleets import StoreResult as StoreResult
    from enginediag_cli.api.fleets import fleet as fleet
    from enginediag_cli.api.fleets import fleet_status as fleet_status
    from enginediag_cli.api.fleets import merge_stores as merge_stores
    from enginediag_cli.api.fleets import prune_store as prune_store
    from enginediag_cli.api.identification import IdentificationResult as IdentificationResult
    from enginediag_cli.api.identification import identify as identify
    from enginediag_cli.api.inputs import Recordings as Recordings
    from enginediag_cli.api.inputs import load_engine as load_engine
    from enginediag_cli.api.inputs import load_nominal as load_nominal
    from enginediag_cli.api.inputs import read_recordings as read_recordings
    from enginediag_cli.api.isolation import IsolationResult as IsolationResult
    from enginediag_cli.api.isolation import isolate as isolate
    from enginediag_cli.api.over_time import MarginOptions as MarginOptions
    from enginediag_cli.api.over_time import TrendResult as TrendResult
    from enginediag_cli.api.over_time import forecast as forecast
    from enginediag_cli.api.over_time import trend as trend
    from enginediag_cli.api.refinement import RefineResult as RefineResult
    from enginediag_cli.api.refinement import refine as refine
    from enginediag_cli.api.reporting import ReportPage as ReportPage
    from enginediag_cli.api.reporting import report as report
    from enginediag_cli.api.results import DocumentResult as DocumentResult
    from enginediag_cli.api.results import MessageLog as MessageLog
    from enginediag_cli.api.results import Picture as Picture
    from enginediag_cli.api.results import Result as Result
    from enginediag_cli.api.simulation import SimulationResult as SimulationResult
    from enginediag_cli.api.simulation import simulate as simulate
    from enginediag_cli.api.windows import WindowOptions as WindowOptions
    from enginediag_cli.recordings.provenance import header_lines as header_lines
    from enginediag_cli.recordings.provenance import provenance_notes as provenance_notes

HOMES = {
    "api.building_blocks": (
        "Description",
        "Listing",
        "describe_component",
        "describe_effect",
        "list_components",
        "list_effects",
        "list_law_variables",
    ),
    "api.detection": (
        "DetectionResult",
        "FollowResult",
        "MethodResult",
        "ResidualResult",
        "detect",
        "detect_by_method",
        "follow",
        "residual",
    ),
    "api.discrepancy": (
        "ExplainResult",
        "LocateResult",
        "PerRecordResult",
        "SearchOptions",
        "effect_names",
        "explain",
        "locate",
        "locate_per_record",
    ),
    "api.fleets": ("FleetResult", "StoreResult", "fleet", "fleet_status", "merge_stores", "prune_store"),
    "api.files": ("CheckResult", "RecorderDraft", "check", "draft_recorder"),
    "api.identification": ("IdentificationResult", "identify"),
    "api.inputs": ("Recordings", "load_engine", "load_nominal", "read_recordings"),
    "api.isolation": ("IsolationResult", "isolate"),
    "api.over_time": ("MarginOptions", "TrendResult", "forecast", "trend"),
    "api.refinement": ("RefineResult", "refine"),
    "api.reporting": ("ReportPage", "report"),
    "api.results": ("DocumentResult", "MessageLog", "Picture", "Result"),
    "api.simulation": ("SimulationResult", "simulate"),
    "api.windows": ("WindowOptions",),
    "recordings.provenance": ("header_lines", "provenance_notes"),
}
"""Module → names that it gives to the library; a module is loaded when one of its names is first used."""
_HOME = {name: module for module, names in HOMES.items() for name in names}

__all__ = list(_HOME)


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"enginediag_cli.{_HOME[name]}"), name)
