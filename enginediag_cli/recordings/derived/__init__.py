"""Columns computed from recorded ones; a recorder YAML lists those that it needs."""

from __future__ import annotations

from enginediag_cli.recordings.derived.rules import (
    CONSENSUS,
    HUMIDITY_RATIO,
    ISA_DEVIATION,
    MACH_FROM_CAS,
    MACH_FROM_TAS,
    PRODUCT,
    SOAK,
    STATIC_TEMPERATURE,
    SUM,
    Rule,
)

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
