"""The `identification:` block of an engine file: as values."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from enginediag_cli.engine.identification_block import IDENTIFICATION


@dataclass(frozen=True)
class IdentificationSettings:
    """The `identification:` block as values; the field names are its keys (see `IDENTIFICATION`)."""

    parameters: tuple[str, ...] = ()
    fixed: tuple[str, ...] = ()
    prior_mean: Mapping[str, float] = field(default_factory=dict)
    prior_sigma: Mapping[str, float] = field(default_factory=dict)
    sensors: tuple[str, ...] = ()
    noise_sigma: Mapping[str, float] = field(default_factory=dict)
    noise: str = "estimate"
    monitoring_noise: str = "fit"
    recording_bias_sigma: Mapping[str, float] = field(default_factory=dict)
    recording_scale_sigma: Mapping[str, float] = field(default_factory=dict)
    loss: str = "soft_l1"
    loss_scale: float = 2.5
    cross_validation_block: int = 0
    max_iterations: int = 75

    def after(self, steps: int) -> IdentificationSettings:
        """What is left when so many steps have been taken."""
        return replace(self, max_iterations=max(self.max_iterations - steps, 0))


def settings_from_mapping(block: Mapping[str, Any] | None) -> IdentificationSettings:
    """Settings from a validated `identification:` block; keys that are absent keep their defaults."""
    if not block:
        return IdentificationSettings()
    declared = {f.name: f for f in IDENTIFICATION.fields}
    unknown = sorted(set(block) - set(declared))
    if unknown:
        raise ValueError(f"unknown keys in `identification:`: {', '.join(unknown)}")
    values: dict[str, Any] = {
        k: tuple(v) if declared[k].kind == "texts" else v for k, v in block.items() if v is not None
    }
    return IdentificationSettings(**values)
