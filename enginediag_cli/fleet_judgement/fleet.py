"""The judgement of a fleet: which engines stand out, in which order, how long they last, and what is common to all."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from enginediag_cli.detection.e_bh import listed
from enginediag_cli.fleet_judgement.alike import common_changes
from enginediag_cli.fleet_judgement.finding import (
    CHANGED,
    NO_VERDICT,
    Discoveries,
    EngineFinding,
    FleetFinding,
    FleetSettings,
)
from enginediag_cli.fleet_judgement.remaining import with_forecasts
from enginediag_cli.parameters import Parameter


def judged_fleet(
    findings: Sequence[EngineFinding], settings: FleetSettings, known: Mapping[str, Parameter] | None = None
) -> FleetFinding:
    """The fleet of these engines. known: what the parameters are, as a series knows them."""
    judged = [f for f in findings if f.verdict != NO_VERDICT or np.isfinite(f.log10_e)]
    chosen = listed(np.array([f.log10_e for f in judged]) * np.log(10), settings.false_discovery)
    found = {f.serial for f, of_them in zip(judged, chosen.tolist(), strict=True) if of_them}
    told = with_forecasts([_listed(f) if f.serial in found else f for f in findings], settings)
    ranked = sorted(told, key=lambda f: -np.nan_to_num(f.severity.value, nan=-np.inf))
    names = [f.serial for f in sorted(judged, key=lambda f: -f.log10_e) if f.serial in found]
    return FleetFinding(
        tuple(ranked),
        Discoveries(tuple(names), settings.false_discovery, bound_in_words(len(names), settings.false_discovery)),
        common_changes(findings, known),
        tuple((f.serial, f.reason) for f in findings if f.verdict == NO_VERDICT),
    )


def _listed(finding: EngineFinding) -> EngineFinding:
    """A finding on the list, which is a change whatever its own false-alarm probability says."""
    if finding.verdict == CHANGED:
        return replace(finding, discovery=True)
    reason = "its evidence is enough for the fleet's list, and not for an alarm of its own"
    return replace(finding, discovery=True, verdict=CHANGED, reason=reason)


def bound_in_words(count: int, level: float) -> str:
    """What a list of so many engines promises."""
    share = f"{100 * level:g} %"
    if not count:
        return f"no engine is listed; of lists made so, at most {share} of the engines on them are healthy on average"
    return (
        f"of the engines listed ({count}) at most {share} are healthy, on average over such lists, whenever one looks "
        "and however the engines depend on each other"
    )
