"""Where a law begins: its stops, and what tells when it acts, from the records alone.

Records that stand still give the actuator's positions, solved for by the law itself between the widest stops. Of the
others those beyond the set point on the side to which the actuator has no way left are at a stop; the rest either rest
where nothing sets the actuator although the law would move it, so that something else must release it, or have met the
far stop. The other readings tell which. The release is sought among the inputs: one threshold on one of them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from enginediag_cli.engine.engine import Engine
from enginediag_cli.engine.load import EngineDescription
from enginediag_cli.engine.network import position_column
from enginediag_cli.errors import ConfigError
from enginediag_cli.mismatch.controlled.actuators import Free
from enginediag_cli.mismatch.controlled.law import ControlLaw, Enabled
from enginediag_cli.mismatch.controlled.still import Still

FARTHEST = 0.99
"""Quantile of the positions of held records where the far stop is begun with: a few are wild."""
LEAST_RELEASED = 0.02
"""Share of the records that must be seen to be released before a release is sought."""
WRONG = 0.05
"""Share of either kind of record that a threshold may tell wrongly."""
SURELY = 0.25
"""Share of its way that an actuator must have gone for a reading to be at its set point for that reason. Judgement: as
much as the maps' errors move where it seems to stand."""
WITHIN = 0.98
"""Of the gap that nothing was seen in, what is certainly inside, whatever digits are written."""
NO_WAY = 1e-3
"""Share of an actuator's way that is none."""
COMPARED = 2000
"""Records, evenly chosen, from which a start is found."""


@dataclass(frozen=True)
class Records:
    """What is known of N records: inputs (N,) by column, readings (N, m) of `sensors`, in their units, and what the
    engine as described says of them, NaN where it has no solution."""

    inputs: Mapping[str, np.ndarray]
    sensors: tuple[str, ...]
    measured: np.ndarray
    described: np.ndarray

    def some(self) -> tuple[Records, np.ndarray]:
        """COMPARED of them at most, and which."""
        n = len(self.measured)
        at = np.unique(np.linspace(0, n - 1, min(n, COMPARED)).astype(int))
        inputs = {c: np.broadcast_to(v, (n,))[at] for c, v in self.inputs.items()}
        return Records(inputs, self.sensors, self.measured[at], self.described[at]), at


@dataclass(frozen=True)
class Begun:
    """A law with its first numbers; `left`: mean |ln(measured/predicted)| of the other readings of the held records
    with it, `without`: the same without it."""

    law: ControlLaw
    left: float
    without: float


def begin(described: EngineDescription, engine: Engine, free: Free, still: Still, records: Records) -> Begun | None:
    """None where the actuator does not move the reading, or nothing tells when the law acts."""
    a = free.actuator
    law = ControlLaw(a, free.component, still.sensor, still.value, a.lower, a.upper, key=free.key, assumed=free.assumed)
    try:
        with_law = law.engine(described, engine.power_setting)
    except ConfigError:
        return None
    values = {n: p.nominal for n, p in engine.parameters.items() if n in with_law.parameters}
    some, chosen = records.some()
    held = still.at[chosen]
    there = _at(with_law, some, values, held)
    position = there[1][:, 0]
    known = np.isfinite(position)
    if known.sum() < 0.5 * held.sum():
        return None
    others = [j for j, s in enumerate(some.sensors) if s != still.sensor]
    left = _misfit(there[0][:, others], some.measured[held][:, others])
    without = _misfit(some.described[held][:, others], some.measured[held][:, others])
    ends = np.quantile(position[known], [1.0 - FARTHEST, FARTHEST])
    slack = NO_WAY * (a.upper - a.lower)
    low, high = min(float(ends[0]), a.neutral), max(float(ends[1]), a.neutral)
    if not high - low > slack:
        return None
    begun = Begun(replace(law, low=low, high=high), left, without)
    if low < a.neutral - slack and high > a.neutral + slack:
        return begun  # it goes both ways from where nothing sets it, and rests at neither end
    one_way = (low, a.neutral) if low < a.neutral - slack else (a.neutral, high)
    begun = replace(begun, law=replace(begun.law, low=one_way[0], high=one_way[1]))
    moved = np.zeros(len(held), dtype=bool)
    moved[held] = np.abs(position - a.neutral) > SURELY * (high - low)
    return _enabled(begun, with_law, some, still, (held, moved), values)


def _enabled(
    begun: Begun,
    engine: Engine,
    some: Records,
    still: Still,
    rows: tuple[np.ndarray, np.ndarray],
    values: Mapping[str, float],
) -> Begun | None:
    """The law with what tells when it acts; None where the records say that it does not always act and no input says
    when. `rows`: records (N,) at the set point, and those of them that are there because the actuator has moved: others
    may be there by chance."""
    held, moved = rows
    law, away = begun.law, ~held
    j = some.sensors.index(still.sensor)
    rest, far = (law.low, law.high) if law.low == law.actuator.neutral else (law.high, law.low)
    at_rest = _at(engine, some, {**values, **_fixed(law, rest)}, away)[0]
    at_far = _at(engine, some, {**values, **_fixed(law, far)}, away)[0]
    y = some.measured[away]
    nearer_rest = _distance(at_rest, y) < _distance(at_far, y)
    # towards the far stop the reading goes from what it is at rest to the set point: then it is not there by itself
    way = np.sign(np.nanmedian(at_far[:, j] - at_rest[:, j]))
    short = way * (y[:, j] - still.value) < 0.0
    released = np.zeros(len(held), dtype=bool)
    released[np.flatnonzero(away)[nearer_rest & short]] = True
    if released.mean() < LEAST_RELEASED:
        return begun
    acting = moved.copy()
    acting[np.flatnonzero(away)[~nearer_rest & short]] = True
    enabled = _threshold(some.inputs, engine, acting, released)
    return None if enabled is None else replace(begun, law=replace(law, enabled=enabled))


def _threshold(
    inputs: Mapping[str, np.ndarray], engine: Engine, acting: np.ndarray, released: np.ndarray
) -> Enabled | None:
    """The input and the threshold on it that tell best which of these records (N,) are released."""
    best: Enabled | None = None
    ordered = sorted(engine.inputs, key=lambda c: c != engine.power_setting)
    for column in ordered:
        x = np.broadcast_to(inputs[column], acting.shape)
        for side, sign in (("at_most", 1.0), ("at_least", -1.0)):
            a, r = np.sort(sign * x[acting]), np.sort(sign * x[released])
            cuts = np.unique(np.concatenate([a, r]))
            cuts = 0.5 * (cuts[1:] + cuts[:-1])
            if not cuts.size:
                continue
            wrong = np.maximum(
                1.0 - np.searchsorted(a, cuts, side="right") / len(a), np.searchsorted(r, cuts, side="right") / len(r)
            )
            k = int(np.argmin(wrong))
            if wrong[k] < (best.wrong if best else WRONG):
                # nothing was seen between the last that acts and the first that is released, midway of which it lies
                unseen = float(r[r > cuts[k]].min(initial=np.inf) - a[a <= cuts[k]].max(initial=-np.inf))
                best = Enabled(column, side, float(sign * cuts[k]), float(wrong[k]), WITHIN * 0.5 * unseen)
    return best


def _at(engine: Engine, some: Records, values: Mapping[str, float], rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Readings (n, m) and positions of the actuators (n, k) of these records, NaN where there are none."""
    inputs = {c: v[rows] for c, v in some.inputs.items()}
    also = [position_column(leaf) for c in engine.network.controls[-1:] for leaf in c.position()]
    found = engine.predict(inputs, values, sensors=some.sensors, also=also)
    return np.where(found.ok[:, None], found.y, np.nan), found.also


def _fixed(law: ControlLaw, position: float) -> dict[str, float]:
    """As good as fixed: without any way between its stops the actuator would move nothing, and nothing find it."""
    low, high = law.stops.values()
    return {low: position, high: position + NO_WAY * (law.actuator.upper - law.actuator.lower)}


def _distance(predicted: np.ndarray, measured: np.ndarray) -> np.ndarray:
    """Mean |ln ratio| of the readings of each record (n,)."""
    with np.errstate(all="ignore"):
        far = np.abs(np.log(predicted / measured))
    read = np.isfinite(far)
    return np.asarray(np.where(read, far, 0.0).sum(axis=1) / np.where(read.any(axis=1), read.sum(axis=1), np.nan))


def _misfit(predicted: np.ndarray, measured: np.ndarray) -> float:
    return float(np.nanmedian(_distance(predicted, measured)))


def ranked(begun: Sequence[Begun]) -> list[Begun]:
    """Those that are nearer the other readings than the model without, the nearest first."""
    return sorted((b for b in begun if b.left < b.without), key=lambda b: b.left)
