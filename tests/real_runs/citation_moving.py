"""The Citation's engines in transients: inertias and lags found on half a flight of one engine, judged on all others.

    python tests/real_runs/citation_moving.py [--format json]

Each engine is identified on the steady records of flight_ref as ever. Then every record of the first half of flight_ref
of the left engine that is in the air fits inertias, lag of the probe, clocks, heat soak and the soak terms of the
readings, for several sets of terms; blocks of that half that are left out in turn decide between the sets. Nothing is
fitted to what is judged but the flight's own offset of each reading, the median over its steady records, with the
steady model (before) and with the one that moves (after) alike. Moving: |dN1/dt| > 30 rpm/s; steady: what the
recorder's gate keeps; both in the air as the gate means it. On the ground, too: all moving records of the engine's
envelope. Flight b22 has a bleed that neither model knows.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
from citation_mismatch import B22, ENGINE, N2_POINT_RPM, RECORDER, REF, SIDES, nominal
from ground_recordings import public_data

from enginediag_cli.engine.engine import Engine
from enginediag_cli.engine.moving.tape import MOMENT
from enginediag_cli.identification.nominal import Nominal
from enginediag_cli.identification.nominal_file import read_nominal
from enginediag_cli.physics.engine_file import load_engine
from enginediag_cli.physics.registry import effect
from enginediag_cli.recordings.read import read_all
from enginediag_cli.recordings.recorder import load_recorder

SENSORS = ("N2_rpm", "ITT_K", "Wf_kg_s")
SCALE = np.array([100.0, 6.0, 0.03])
"""What a moving model may err by, N2 in rpm, ITT in K, fuel flow as a share: the weight of each reading in the fit."""
ROBUST = 3.0
"""Times SCALE: beyond, errors count by their size and not by its square."""
MOVING_RPM_S = 30.0
BLOCK_S = 300.0
"""Blocks of time that are left out in turn, odd and even, to decide between sets of terms. Longer than any memory."""
WORTH = 0.02
"""A larger set must lower the cost of blocks left out by this share."""

Label = tuple[str, str]
INERTIA: tuple[Label, ...] = (("rotor_inertia", "hp"), ("rotor_inertia", "lp"))
PROBE: tuple[Label, ...] = (("probe_lag", "ITT"),)
CLOCKS: tuple[Label, ...] = (("clock_shift", "N2"), ("clock_shift", "ITT"), ("clock_shift", "Wf"))
SETS: Mapping[str, tuple[Label, ...]] = {
    "inertias": INERTIA,
    "inertias, probe lag": INERTIA + PROBE,
    "inertias, probe lag, clocks": INERTIA + PROBE + CLOCKS,
    "inertias, probe lag, clocks, heat soak of the LP turbine": INERTIA + PROBE + CLOCKS + (("heat_soak", "lpt"),),
}
"""From few terms to many, as they are tried."""
BEGUN = {"inertia": 0.1, "time_constant": 3.0, "delay": 0.2, "exchange": 0.03}
"""Where a fit begins, by coefficient; the time constant of metal is begun at METAL_S."""
METAL_S = 30.0
SOAK = ("sensor.N2.soak", "sensor.ITT.soak", "sensor.Wf.soak")
"""Heat soak as the steady engine has it, in the readings: fitted anew beside the terms that remember."""


@dataclass(frozen=True)
class Run:
    """All records of one flight of one engine that its envelope covers: columns, readings (N, 3), and which records
    (N,) move, are in the air, are steady."""

    nominal: Nominal
    columns: Mapping[str, np.ndarray]
    measured: np.ndarray
    moving: np.ndarray
    air: np.ndarray
    steady: np.ndarray

    @property
    def time(self) -> np.ndarray:
        return self.columns["time_s"]


@cache
def engine() -> Engine:
    return load_engine(ENGINE)


def run_of(flights: Path, name: str, side: str, folder: Path) -> Run:
    recorder, raw = load_recorder(RECORDER), read_all(flights / name)
    every = {m.engine: m.recording for m in recorder.map(raw, steady=False)}[side]
    kept = {m.engine: m.recording for m in replace(recorder, average_s=0.0).map(raw, steady=True)}[side]
    N1, time = every["N1_rpm"], every["time_s"]
    assert recorder.steady is not None
    air = np.logical_and.reduce([every[c] >= low for c, low in recorder.steady.minimum.items()])
    moving = np.abs(np.gradient(N1, time)) > MOVING_RPM_S
    rows = N1 >= engine().envelope["N1_rpm"][0]
    measured = np.column_stack([every[c] for c in SENSORS])[rows]
    masks = (m[rows] for m in (moving, air, np.isin(time, kept["time_s"])))
    columns = {c: v[rows] for c, v in every.columns.items()}
    return Run(read_nominal(nominal(folder, flights, side)), columns, measured, *masks)


class Model:
    """An engine at its nominal state, errors of its maps included, with terms that remember, on a run's tape."""

    def __init__(self, run: Run, labels: Sequence[Label]):
        self.run = run
        self.bare = engine().with_effects([effect(engine(), *label) for label in labels])
        maps = run.nominal.error_model
        self._model = self.bare if maps is None else maps.of(self.bare)
        asked = (*engine().inputs, *engine().optional_inputs)
        self._inputs = {c: run.columns[c] for c in asked if c in run.columns}
        if labels:
            self._inputs[MOMENT] = self.bare.tapes.add(run.columns)

    def errors(
        self, values: Mapping[str, float], wrt: Sequence[str] = (), zero: np.ndarray | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """Readings less predictions (N, 3), of the fuel flow as a share, less the median of the flight's steady records
        (those of `zero`, if given), and their derivatives (N, 3, p)."""
        p = self._model.predict(self._inputs, {**self.run.nominal.theta0, **values}, sensors=SENSORS, wrt=wrt)
        unit = np.where(np.arange(3) == 2, self.run.measured, 1.0)
        e, J = (self.run.measured - p.y) / unit, -p.jacobian / unit[:, :, None]
        rows = self.run.steady if zero is None else zero
        return e - np.nanmedian(e[rows], axis=0), J - np.nanmean(J[rows], axis=0)


@dataclass(frozen=True)
class Fitted:
    """Coefficients by name, those of the soak of readings among them, and their standard errors."""

    labels: tuple[Label, ...]
    values: Mapping[str, float]
    errors: Mapping[str, float]


def fit(run: Run, labels: tuple[Label, ...], rows: np.ndarray) -> Fitted:
    """The set of terms fitted to some of the run's records (N,)."""
    from scipy.optimize import least_squares

    model = Model(run, labels)
    start = {n: run.nominal.theta0[n] for n in SOAK}
    for e in (effect(engine(), *label) for label in labels):
        for name, quantity in zip(e.amplitudes, (a.rpartition(".")[2] for a in e.amplitudes), strict=True):
            start[name] = METAL_S if e.term.NAME == "heat_soak" and quantity == "time_constant" else BEGUN[quantity]
    names = tuple(start)
    zero = run.steady & rows
    used = rows & np.isfinite(model.errors(start, (), zero)[0]).all(axis=1)

    def residual(x: np.ndarray) -> np.ndarray:
        return (model.errors(dict(zip(names, x, strict=True)), (), zero)[0][used] / SCALE).ravel()

    def slopes(x: np.ndarray) -> np.ndarray:
        J = model.errors(dict(zip(names, x, strict=True)), names, zero)[1][used]
        return np.nan_to_num(J / SCALE[:, None]).reshape(-1, len(names))

    parameters = [model.bare.parameters[n] for n in names]
    bounds = ([p.lower for p in parameters], [p.upper for p in parameters])
    found = least_squares(
        residual, list(start.values()), slopes, bounds, loss="huber", f_scale=ROBUST, x_scale="jac", ftol=1e-3
    )
    if not found.success:
        raise SystemExit(f"the fit of {labels} did not converge: {found.message}")
    spread = np.sqrt(np.diag(np.linalg.pinv(found.jac.T @ found.jac)) * 2.0 * found.cost / max(len(found.fun), 1))
    return Fitted(labels, dict(zip(names, found.x, strict=True)), dict(zip(names, spread, strict=True)))


def cost(run: Run, fitted: Fitted, rows: np.ndarray) -> float:
    """What a fit leaves of the moving records among `rows`, per reading, as the fit weighs it."""
    u = np.abs(Model(run, fitted.labels).errors(fitted.values)[0][rows & run.moving] / SCALE)
    if not np.isfinite(u).all():
        return np.inf  # does not settle: no prediction
    return float(np.mean(np.where(u < ROBUST, u**2, 2.0 * ROBUST * u - ROBUST**2)))


def chosen(run: Run, rows: np.ndarray) -> tuple[str, dict[str, float]]:
    """The set of terms that blocks of the training records left out in turn decide for, and each set's cost."""
    odd = (run.time // BLOCK_S) % 2 == 1
    costs, best = {}, ""
    for name, labels in SETS.items():
        folds = [(rows & odd, rows & ~odd), (rows & ~odd, rows & odd)]
        costs[name] = float(np.mean([cost(run, fit(run, labels, own), other) for own, other in folds]))
        if not best or costs[name] < (1.0 - WORTH) * costs[best]:
            best = name
    return best, costs


def rms(errors: np.ndarray, rows: np.ndarray) -> dict[str, float]:
    """RMS of errors (N, 3) at some records: N2 in points, ITT in K, fuel flow in per cent, and how many records."""
    e = errors[rows]
    good = np.isfinite(e).all(axis=1)
    N2, ITT, Wf = (float(v) for v in np.sqrt(np.mean(e[good] ** 2, axis=0))) if good.any() else (np.nan,) * 3
    return {
        "N2_points": round(N2 / N2_POINT_RPM, 2),
        "ITT_K": round(ITT, 1),
        "Wf_pct": round(100.0 * Wf, 2),
        "records": int(good.sum()),
        "without_prediction": int((~good).sum()),
    }


Judged = dict[str, dict[str, dict[str, float]]]


def judged(run: Run, fitted: Fitted, of: np.ndarray) -> Judged:
    """RMS before and after over the moving, steady, and, with those on the ground, all moving records among `of`."""
    kinds = {"moving": run.moving & run.air, "steady": run.steady, "moving_with_ground": run.moving}
    arms = {
        "before": Model(run, ()).errors({})[0],
        "after": Model(run, fitted.labels).errors(fitted.values)[0],
    }
    return {k: {arm: rms(e, rows & of) for arm, e in arms.items()} for k, rows in kinds.items()}


def story(flights: Path, folder: Path) -> dict[str, object]:
    """What is named, its coefficients, and how it does on what trained it and on what did not."""
    left = run_of(flights, REF, "left", folder)
    first = left.time < np.median(left.time)
    rows = first & left.air
    name, costs = chosen(left, rows)
    fitted = fit(left, SETS[name], rows)
    there = {"trained: left, flight_ref, first half": judged(left, fitted, first)}
    there["left, flight_ref, second half"] = judged(left, fitted, ~first)
    for side, flight in (("left", B22), *((SIDES[1], f) for f in (REF, B22))):
        run = run_of(flights, flight, side, folder)
        there[f"{side}, {flight.partition('.')[0]}"] = judged(run, fitted, np.ones(len(run.time), bool))
    return {
        "named": name,
        "cost_of_blocks_left_out": {n: round(c, 3) for n, c in costs.items()},
        "coefficients": {n: [float(f"{v:.4g}"), float(f"{fitted.errors[n]:.2g}")] for n, v in fitted.values.items()},
        "rms": there,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--format", choices=("text", "json"), default="text")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        told = story(public_data("c550_jt15d"), Path(folder))
    if given.format == "json":
        print(json.dumps(told, indent=2))
        return
    print(f"Terms: {told['named']}.\n")
    print("| records | kind | N2, points | ITT, K | fuel flow, % |\n|---|---|---|---|---|")
    for where, kinds in told["rms"].items():
        for kind, arms in kinds.items():
            b, a = arms["before"], arms["after"]
            cells = (f"{b[q]:.3g} → {a[q]:.3g}" for q in ("N2_points", "ITT_K", "Wf_pct"))
            print(f"| {where} | {kind.replace('_', ' ')}, {a['records']} | " + " | ".join(cells) + " |")


if __name__ == "__main__":
    main()
