"""The nominal state of an engine: what later stages measure departures from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from enginediag_cli.engine.description import EngineDescription
from enginediag_cli.error_model.error_model import ErrorModel
from enginediag_cli.error_model.modelled import FAMILY
from enginediag_cli.error_model.points import POINT_FAMILY
from enginediag_cli.identification.envelope import Envelope
from enginediag_cli.identification.lagging_reading import LaggingReading
from enginediag_cli.identification.offset_prior import OffsetPrior
from enginediag_cli.identification.quality import SensorQuality
from enginediag_cli.identification.unidentified import Combination

ENGINE_INSTANCE = "engine instance"
"""Key of `provenance` that names the engine, of those that a recording tells apart, which was identified."""
STATUSES = ("identified", "weak", "at prior", "at bound")
IDENTIFIED, WEAK = 0.75, 0.1
"""Shares of the prior variance that the data removed: half the prior's sigma is left, or 95 % of it."""


@dataclass(frozen=True)
class Estimate:
    """One parameter in its own unit. `from_data` is 1 − posterior variance / prior variance.

    Status: identified (the data at least halved the prior's standard deviation), weak, at prior (the value is
    what was assumed before, not a finding), at bound (the data push against a physical limit).
    """

    name: str
    family: str
    unit: str
    value: float
    standard_error: float
    prior_mean: float
    prior_sigma: float
    from_data: float
    status: str


@dataclass(frozen=True)
class SensorNoise:
    """Noise of one reading in the column's unit, correlation from one record to the next, and readings.

    `sigma_from` (see `noise.SIGMA_FROM`) and `degrees` of freedom say how well sigma is known, `rho1_error` how well
    rho1 is, and `rho1_common` an error of rho1 that all sensors share; `kurtosis` is the excess kurtosis. A file
    without them has noise that is certain and Gaussian.
    """

    sensor: str
    sigma: float
    rho1: float
    n: int
    n_effective: float
    outliers: int
    sigma_from: str = "stated"
    degrees: float = 0.0
    rho1_error: float = 0.0
    rho1_common: float = 0.0
    kurtosis: float = 0.0


@dataclass(frozen=True)
class Nominal:
    """Nominal parameters, noise, and what they are worth, as identified from healthy recordings.

    `covariance` (p, p) is that of the estimates, in their units and order. `noise_correlation` (m, m) is
    between sensors in one record. `recording_offsets`: recording → "column bias" or "column scale" → value.
    `smooth`: whether a fit over the operating points stands for what is uncertain about it (see `residuals.compact`),
    None where that was not tried. `error_model`: by how much the maps may be wrong, None for a model without maps.
    `lagging`: readings that lag behind the model where the engine moves.
    `description`: the engine that was identified, as text, which stands for its file; None in older files.
    `sealed`: false when it was read from a file without a checksum, which may have been
    edited by anyone.
    """

    engine_path: str
    engine_sha256: str
    inputs: tuple[str, ...]
    estimates: tuple[Estimate, ...]
    covariance: np.ndarray
    noise: tuple[SensorNoise, ...]
    noise_correlation: np.ndarray
    offsets: tuple[OffsetPrior, ...]
    recording_offsets: Mapping[str, Mapping[str, float]]
    in_sample: tuple[SensorQuality, ...]
    cross_validated: tuple[SensorQuality, ...]
    held_out: tuple[SensorQuality, ...]
    unidentified: tuple[Combination, ...]
    envelope: Envelope
    records: Mapping[str, int]
    provenance: Mapping[str, str]
    sealed: bool = True
    smooth: bool | None = None
    error_model: ErrorModel | None = None
    description: EngineDescription | None = None
    lagging: tuple[LaggingReading, ...] = ()

    @property
    def engine_instance(self) -> str:
        """The engine whose recordings were used, where one was chosen by name; '' otherwise."""
        return self.provenance.get(ENGINE_INSTANCE, "")

    @property
    def theta0(self) -> dict[str, float]:
        """Nominal value of every estimated parameter, amounts of map error among them."""
        return {e.name: e.value for e in self.estimates}

    @property
    def engine_values(self) -> dict[str, float]:
        """Nominal value of every estimated parameter of the engine itself, amounts of map error left aside."""
        return {e.name: e.value for e in self.estimates if e.family not in (FAMILY, POINT_FAMILY)}

    @property
    def sensors(self) -> tuple[str, ...]:
        """Columns that were fitted."""
        return tuple(n.sensor for n in self.noise)

    @property
    def sigma(self) -> dict[str, float]:
        """Standard deviation of one reading per sensor, in the column's unit."""
        return {n.sensor: n.sigma for n in self.noise}

    @property
    def rho1(self) -> dict[str, float]:
        """Lag-1 correlation between consecutive records per sensor."""
        return {n.sensor: n.rho1 for n in self.noise}


def status_of(from_data: float, at_bound: bool) -> str:
    """Status of an estimate from the share that the data contributed."""
    if at_bound:
        return "at bound"
    if from_data >= IDENTIFIED:
        return "identified"
    return "weak" if from_data >= WEAK else "at prior"
