"""A trial's recordings: what the truth engine's sensors read, and the files that the explainer is given."""

from __future__ import annotations

import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from enginediag_cli.engine.engine import Engine
from enginediag_cli.engine.moving.tape import MOMENT
from enginediag_cli.mismatch.fit.evidence import Flight
from enginediag_cli.recordings.table import Recording
from enginediag_cli.recordings.write import CsvWriter, output
from enginediag_cli.validation.blind import kinds
from enginediag_cli.validation.blind.causes import Cause
from enginediag_cli.validation.blind.flights import hour_columns, stack
from enginediag_cli.validation.blind.sealed import Sealed
from enginediag_cli.validation.blind.truths.realistic import realistic_engine


@dataclass(frozen=True)
class Recorded:
    """Flights with noise, and without, both of the same records; `kept` (N,): their place among those drawn; `failed`:
    how many the truth engine could not compute."""

    noisy: tuple[Flight, ...]
    clean: tuple[Flight, ...]
    kept: np.ndarray
    failed: int

    def place(self, cause: Cause) -> Cause:
        """The cause with its step counted among the kept records."""
        return cause if not cause.is_step else Cause(cause.name, int(np.searchsorted(self.kept, cause.first)))


def readings(engine: Engine, sealed: Sealed, *, exact_model: bool) -> np.ndarray:
    """What the sensors read without noise, (N, m), NaN where the truth engine has no solution. `exact_model`: the
    truth without its map errors and on the model's own maps."""
    u = stack(sealed.flights)
    n = len(u["time_s"])
    errors = None if exact_model else sealed.map_errors
    base = engine if exact_model or sealed.realistic is None else realistic_engine(engine, sealed.realistic, u)
    truth = base.with_effects((*engine.effects, *sealed.effects, *(errors.effects if errors else ())))
    theta: dict[str, float | np.ndarray] = {**sealed.health, **sealed.values}
    for cause in sealed.causes:
        if cause.is_step:
            change = sealed.changes.get(cause.name, sealed.change)
            theta[cause.name] = sealed.health[cause.name] + change * (np.arange(n) >= cause.first)
    if sealed.states is not None:
        for e in sealed.effects:
            for c in e.term.amplitudes():
                name = e.parameter_name(c.name)
                theta[name] = c.absent + (sealed.values[name] - c.absent) * sealed.states
    inputs = {c: u[c] for c in (*truth.inputs, *truth.optional_inputs) if c in u}
    if kinds.moves(sealed.kind):
        # the truth remembers what it was told, not what was read of it
        told = [{c: f[c] for c in ("time_s", *truth.inputs)} for f in sealed.flights]
        inputs[MOMENT] = np.concatenate([truth.tapes.add(f) for f in told])
    if errors:
        theta.update(errors.parameters)
        inputs["humidity_kg_kg"] = np.full(n, errors.water)
    p = truth.predict(inputs, theta)
    return np.asarray(np.where(p.ok[:, None], p.y, np.nan))


def record(engine: Engine, sealed: Sealed) -> Recorded:
    """Fly the trial and record it."""
    rng = np.random.default_rng(sealed.noise_seed)
    true = readings(engine, sealed, exact_model=False)
    same = sealed.map_errors is None and sealed.realistic is None
    clean = true if same else readings(engine, sealed, exact_model=True)
    kept = np.isfinite(true).all(axis=1) & np.isfinite(clean).all(axis=1)
    sensors = sealed.recorded(engine)
    sigma = np.array([s.noise_sigma for s in engine.sensors.values()]) * sealed.noise.factor
    noisy_flights, clean_flights, start = [], [], 0
    for k, flight in enumerate(sealed.flights):
        n = len(flight["time_s"])
        rows = slice(start, start + n)
        good = kept[rows]
        label = f"flight_{k + 1}"
        if sealed.realistic is not None:
            read = sealed.realistic.read(k, {**flight, **dict(zip(engine.sensors, true[rows].T, strict=True))})
            read = sealed.realistic.write(engine, read, rng)
        else:
            noise = sigma * _remembering(rng.standard_normal((n, len(sigma))), sealed.noise.rho)
            read = _with_input_noise(flight, sealed, rng)
            read |= dict(zip(engine.sensors, (true[rows] + noise).T, strict=True))
        exact = {**flight, **dict(zip(engine.sensors, clean[rows].T, strict=True))}
        noisy_flights.append(_flight(engine, label, read, sensors, good))
        clean_flights.append(_flight(engine, label, exact, sensors, good))
        start += n
    return Recorded(tuple(noisy_flights), tuple(clean_flights), np.flatnonzero(kept), int((~kept).sum()))


def write_open(folder: Path, engine: Engine, recorded: Recorded, training: int) -> tuple[Path, list[Path]]:
    """The open folder: the engine file and its maps as they are, and the flights that are not held back."""
    paths = []
    for flight in recorded.noisy[:training]:
        path = folder / f"{flight.label}.csv"
        with output(path) as stream:
            CsvWriter(stream).write(Recording(dict(flight.columns)))
        paths.append(path)
    return copy_engine(folder, engine), paths


def copy_engine(folder: Path, engine: Engine) -> Path:
    """The engine file and its maps as they are, copied into the folder; the engine file there."""
    given = Path(engine.path)
    tables = [c.values["table"]["file"] for c in engine.network.components if c.values.get("table")]
    for name in dict.fromkeys((given.name, *tables)):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(given.parent / name, folder / name)
    return folder / given.name


def _flight(
    engine: Engine, label: str, read: Mapping[str, np.ndarray], sensors: Sequence[str], good: np.ndarray
) -> Flight:
    return Flight(label, "", {c: read[c][good] for c in ("time_s", *engine.inputs, *hour_columns(), *sensors)})


def _remembering(white: np.ndarray, rho: float) -> np.ndarray:
    """AR(1) of unit variance from white noise (n, m): e_k = ρ e_{k−1} + √(1 − ρ²) w_k."""
    e = white.copy()
    for k in range(1, len(e)):
        e[k] = rho * e[k - 1] + np.sqrt(1.0 - rho**2) * white[k]
    return e


def _with_input_noise(
    flight: Mapping[str, np.ndarray], sealed: Sealed, rng: np.random.Generator
) -> dict[str, np.ndarray]:
    found = dict(flight)
    for c, s in (sealed.noise.inputs or {}).items():
        found[c] = flight[c] + s * rng.standard_normal(len(flight[c]))
    for c, s in (sealed.noise.input_shares or {}).items():
        found[c] = flight[c] * (1.0 + s * rng.standard_normal(len(flight[c])))
    return found
