"""Columns computed from recorded ones, one rule per file; a recorder YAML lists those that it needs."""

from __future__ import annotations

from enginediag_cli.recordings.derived.humidity_ratio import HUMIDITY_RATIO
from enginediag_cli.recordings.derived.isa_deviation import ISA_DEVIATION
from enginediag_cli.recordings.derived.mach_from_cas import MACH_FROM_CAS
from enginediag_cli.recordings.derived.mach_from_tas import MACH_FROM_TAS
from enginediag_cli.recordings.derived.probes import CONSENSUS, SUM
from enginediag_cli.recordings.derived.product import PRODUCT
from enginediag_cli.recordings.derived.rule import Rule
from enginediag_cli.recordings.derived.soak import SOAK
from enginediag_cli.recordings.derived.static_temperature import STATIC_TEMPERATURE

RULES: dict[str, Rule] = {
    rule.section.name: rule
    for rule in (
        CONSENSUS,
        HUMIDITY_RATIO,
        ISA_DEVIATION,
        MACH_FROM_CAS,
        MACH_FROM_TAS,
        PRODUCT,
        SOAK,
        STATIC_TEMPERATURE,
        SUM,
    )
}

__all__ = ["RULES", "Rule"]
