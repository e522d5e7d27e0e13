"""The judgement of a fleet: which engines stand out, in which order, and what is common to all."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from enginediag_cli.fleet_judgement.finding import NO_VERDICT, Discoveries, EngineFinding, FleetFinding, FleetSettings


def judged_fleet(findings: Sequence[EngineFinding], settings: FleetSettings) -> FleetFinding:
    """The fleet of these engines."""
    ranked = sorted(findings, key=lambda f: -np.nan_to_num(f.severity.value, nan=-np.inf))
    left_out = tuple((f.serial, f.reason) for f in findings if f.verdict == NO_VERDICT)
    return FleetFinding(tuple(ranked), Discoveries((), settings.false_discovery, ""), (), left_out)
