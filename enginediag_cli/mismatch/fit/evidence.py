"""What the search for missing physics is given: an engine, flights of one engine or of several, noise, settings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from enginediag_cli.engine.engine import Engine
from enginediag_cli.error_model.maps import ErrorModel
from enginediag_cli.identification.problem import OffsetPrior, TrainingRecording


@dataclass(frozen=True)
class Flight:
    """One recording of one engine: columns (N,) by name. `engine` is "" where the recording names none; `file`: which
    one it is of, "" where it is of none; `at` (N,): places of its records in the recording, counted from 0, None where
    it has all of them."""

    label: str
    engine: str
    columns: Mapping[str, np.ndarray]
    file: str = ""
    at: np.ndarray | None = None

    def __len__(self) -> int:
        """N."""
        return len(next(iter(self.columns.values()), ()))

    def place(self, record: int) -> int:
        """Of a record in the recording, both counted from 0."""
        return record if self.at is None else int(self.at[record])

    def moment(self, record: int) -> str:
        """When a record, counted from 0, was taken: by the flight's clock, where it has one that runs forward."""
        time = np.asarray(self.columns.get("time_s", ()), float)
        if len(time) and np.isfinite(time).all() and (np.diff(time) > 0.0).all():
            return f"{time[record]:.10g} s"
        return f"record {self.place(record) + 1}"


def as_recordings(flights: Sequence[Flight]) -> list[TrainingRecording]:
    """Flights as `identify` takes them."""
    return [TrainingRecording(f.label, f.columns, engine=f.engine) for f in flights]


@dataclass(frozen=True)
class Noise:
    """Of one reading, by sensor column: standard deviation in the column's unit, lag-1 correlation. `inputs`: of one
    reading of an input column, in its unit; `input_shares`: the same as a share of the reading. `estimated`: from
    recordings, not stated: known as well as the independent readings among them allow. `shared`: of engines that fly
    side by side, by sensor column, how many readings say the same, which `sigma` reckons with (√ of it larger)."""

    sigma: Mapping[str, float]
    rho: Mapping[str, float] = field(default_factory=dict)
    inputs: Mapping[str, float] = field(default_factory=dict)
    input_shares: Mapping[str, float] = field(default_factory=dict)
    estimated: bool = False
    shared: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Owed:
    """What evidence owes to the very recordings that are searched: `least`, the noise that is known without them, and
    whether the `priors` are theirs, too."""

    least: Noise
    priors: bool


@dataclass(frozen=True)
class Settings:
    """`nuisance`: parameter → prior standard deviation; `prior_mean`: those not at nominal; `maps`: their error as a
    nominal state has it, None where none is given; `map_accuracy` as in
    `mismatch.settings`; `false_alarm`: probability of naming something on an engine whose model lacks nothing; `loss`
    as in identification ("none" is least squares); `offsets`: sensor → standard deviation of a bias of each recording,
    in the column's unit, and `scale_offsets` of a scale error of each recording, both as stated; `instruments`: offsets
    of outputs, then of inputs, that a nominal state found between recordings; `noise`: "specified" takes the
    evidence's noise at its word, "estimate" only as a start."""

    nuisance: Mapping[str, float]
    prior_mean: Mapping[str, float] = field(default_factory=dict)
    map_accuracy: float = 0.003
    maps: ErrorModel | None = None
    false_alarm: float = 0.05
    loss: str = "none"
    loss_scale: float = 2.5
    offsets: Mapping[str, float] = field(default_factory=dict)
    scale_offsets: Mapping[str, float] = field(default_factory=dict)
    instruments: tuple[OffsetPrior, ...] = ()
    noise: str = "specified"
    seed: int = 0


@dataclass(frozen=True)
class Dataset:
    """`engine` carries what its file says and nothing else."""

    engine: Engine
    flights: tuple[Flight, ...]
    noise: Noise
    settings: Settings
    drivers: tuple[str, ...] = ()  # further recorded columns that may drive an effect
    owed: Owed | None = None  # None where noise and priors come from elsewhere

    @property
    def records(self) -> int:
        """Of all flights."""
        return sum(map(len, self.flights))

    @property
    def engines(self) -> tuple[str, ...]:
        return tuple(dict.fromkeys(f.engine for f in self.flights))

    def only(self, keep: list[int]) -> Dataset:
        """The same with some of the flights, by position."""
        from dataclasses import replace

        return replace(self, flights=tuple(self.flights[k] for k in keep))
