"""What the findings on its engines say of a fleet."""

from __future__ import annotations

from collections.abc import Sequence

from enginediag_cli.fleet_judgement.finding import Discoveries, EngineFinding, FleetFinding, FleetSettings


def judged_fleet(findings: Sequence[EngineFinding], settings: FleetSettings) -> FleetFinding:
    """Stands in until there is one."""
    return FleetFinding(tuple(findings), Discoveries((), settings.false_discovery, ""), (), ())
