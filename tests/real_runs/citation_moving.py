"""The Citation's engines in transients: one engine identified with every record of one flight, judged on all others.

    python tests/real_runs/citation_moving.py [--train left|right] [--flight FILE]... [--format json]

The engine file with inertias of both rotors, lag of the ITT probe and heat soak of the HP turbine among its effects is
identified on flight_ref of one engine, transients, idle and ground included. Nothing of what moves is fitted to what
is judged. The same engine in another flight has the flight's own offset of each reading, the median over its steady
records, and the bleed that switches there, found in steady records as `explain` does, its times in the gaps between
them. The other engine is the same machine with other instruments: scales of N2 and ITT, bias of ITT and the curve of
its fuel meter are taken from those records of its flight_ref that do not move. Before: each engine's own steady
nominal, flight offsets and bleed alike. Moving: |dN1/dt| > 30 rpm/s; steady: what the recorder's gate keeps; both in
the air as the gate means it; with ground: all moving records of the engine's envelope. `--flight`: judge these flights,
of the folder or by their path, instead of flight_b22.
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
import yaml
from citation_mismatch import B22, BLEED, ENGINE, N2_POINT_RPM, RECORDER, REF, SIDES, load, nominal, search
from ground_recordings import public_data

from enginediag_cli.engine.engine import Engine
from enginediag_cli.engine.recall import MOMENT
from enginediag_cli.identification.identify import identify
from enginediag_cli.identification.nominal import Nominal
from enginediag_cli.identification.nominal_file import read_nominal
from enginediag_cli.identification.problem import TrainingRecording
from enginediag_cli.mismatch.fit.identified import stack_column
from enginediag_cli.physics.engine_file import load_engine
from enginediag_cli.physics.registry import effect
from enginediag_cli.recordings.read import read_all
from enginediag_cli.recordings.recorder_file import load_recorder

SENSORS = ("N2_rpm", "ITT_K", "Wf_kg_s")
SCALE = np.array([50.0, 4.0, 0.01])
"""What the moving model errs by where nothing moves, idle included, N2 in rpm, ITT in K, fuel flow as a share."""
STEADY_SCALE = np.array([40.0, 3.0, 0.005])
"""The same in steady records, by which the size of a bleed is found."""
ROBUST = 3.0
"""Times these: beyond, errors count by their size and not by its square."""
REPEATS = 3.0
"""Records at 1 Hz that tell as much as one: neighbours have nearly the same error."""
MOVING_RPM_S = 30.0
NEAR_RECORDS = 5
"""Records on either side of one that moves that are all used; of the others one in EVERY."""
EVERY = 5

TERMS = (
    {"term": "rotor_inertia", "at": "hp", "coefficients": {"inertia": 0.1}},
    {"term": "rotor_inertia", "at": "lp", "coefficients": {"inertia": 0.3}},
    {"term": "probe_lag", "at": "ITT", "coefficients": {"time_constant": 2.0}},
    {"term": "heat_soak", "at": "hpt", "coefficients": {"exchange": 0.03, "time_constant": 30.0}},
)
"""What the engine remembers, and where the fit begins."""
INSTRUMENTS = ("sensor.N2.scale", "sensor.ITT.bias", "sensor.ITT.scale")
METER_KG_S = np.array([0.018, 0.024, 0.032, 0.045, 0.06, 0.085, 0.12, 0.17])
"""Fuel flows between which the curve of a fuel meter runs straight over their logarithm, idle to take-off."""
METER_SIGMA = 0.05
BLEEDS = np.arange(0.0, 0.0601, 0.002)
"""Sizes of the bleed that are tried; steady records decide."""


@dataclass(frozen=True)
class Run:
    """All records of one flight of one engine that its envelope covers: columns, readings (N, 3), and which records
    (N,) move, are in the air, are steady."""

    side: str
    flight: str
    columns: Mapping[str, np.ndarray]
    measured: np.ndarray
    moving: np.ndarray
    air: np.ndarray
    steady: np.ndarray

    @property
    def time(self) -> np.ndarray:
        return self.columns["time_s"]

    @property
    def thinned(self) -> np.ndarray:
        """Which records a fit sees, (N,)."""
        near = np.convolve(self.moving, np.ones(2 * NEAR_RECORDS + 1), "same") > 0.0
        return near | (np.arange(len(self.time)) % EVERY == 0)


@cache
def steady_engine() -> Engine:
    return load_engine(ENGINE)


def run_of(flights: Path, name: str, side: str) -> Run:
    recorder, raw = load_recorder(RECORDER), read_all(flights / name)
    every = {m.engine: m.recording for m in recorder.map(raw, steady=False)}[side]
    kept = {m.engine: m.recording for m in replace(recorder, average_s=0.0).map(raw, steady=True)}[side]
    N1, time = every["N1_rpm"], every["time_s"]
    assert recorder.steady is not None
    air = np.logical_and.reduce([every[c] >= low for c, low in recorder.steady.minimum.items()])
    moving = np.abs(np.gradient(N1, time)) > MOVING_RPM_S
    rows = N1 >= steady_engine().envelope["N1_rpm"][0]
    measured = np.column_stack([every[c] for c in SENSORS])[rows]
    masks = (m[rows] for m in (moving, air, np.isin(time, kept["time_s"])))
    columns = {c: v[rows] for c, v in every.columns.items()}
    return Run(side, name, columns, measured, *masks)


def moving_file(folder: Path) -> Path:
    """The engine file with TERMS among its effects and among what is estimated. Shapes of maps stay as they are stated:
    their smooth errors follow the records."""
    path = folder / "citation_jt15d_moving.yaml"
    if not path.exists():
        declared = yaml.safe_load(Path(ENGINE).read_text())
        declared["physics"] = list(TERMS)
        settings = declared["identification"]
        settings["parameters"] += [f"{t['term']}.{t['at']}.*" for t in TERMS]
        settings["fixed"] += ["*.map.*"]
        settings["monitoring_noise"] = "fit"
        path.write_text(yaml.safe_dump(declared, sort_keys=False))
    return path


def identified(run: Run, path: Path) -> Nominal:
    """The engine that moves, from every record of a flight, thinned where nothing moves."""
    engine = load_engine(str(path))
    columns = {**run.columns, MOMENT: engine.tapes.add(run.columns)}
    kept = {c: v[run.thinned] for c, v in columns.items()}
    result = identify(engine, [TrainingRecording(run.flight, kept)], cross_validation=False)
    if not result.converged:
        raise SystemExit(f"the {run.side} engine was not identified: {result.reason}")
    return result.nominal(str(path), "", {})


class Model:
    """An engine at its nominal state, errors of its maps included, on a run's tape, with a bleed that is on in some
    records (N,)."""

    def __init__(self, path: Path, state: Nominal, run: Run, on: np.ndarray):
        self.run, self.on = run, on
        engine = load_engine(str(path))
        bleed = effect(engine, *BLEED)
        self.amplitude = bleed.amplitudes[0]
        engine = engine.replace_effects([*engine.effects, bleed])
        self.model = engine if state.error_model is None else state.error_model.wrap(engine)
        self.theta = state.theta0
        self._inputs = {c: run.columns[c] for c in (*engine.inputs, *engine.optional_inputs) if c in run.columns}
        self._inputs[MOMENT] = engine.tapes.add(run.columns)

    def errors(
        self, values: Mapping[str, float], bleed: float = 0.0, wrt: Sequence[str] = (), rows: np.ndarray | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """Readings less predictions (n, 3) at some or all records, of the fuel flow as a share, and derivatives."""
        rows = np.ones(len(self.run.time), bool) if rows is None else rows
        inputs = {c: v[rows] for c, v in self._inputs.items()}
        theta = {**self.theta, **values}
        if bleed > 0.0:
            theta[self.amplitude] = bleed * self.on[rows]
        p = self.model.predict(inputs, theta, sensors=SENSORS, wrt=tuple(wrt))
        y = self.run.measured[rows]
        unit = np.where(np.arange(3) == 2, y, 1.0)
        return (y - p.y) / unit, -p.jacobian / unit[:, :, None]


@dataclass(frozen=True)
class Instruments:
    """Those of one engine: values of INSTRUMENTS, and how far its fuel meter is off at METER_KG_S, shares."""

    values: Mapping[str, float]
    curve: np.ndarray

    def meter(self, fuel_kg_s: np.ndarray) -> np.ndarray:
        return np.interp(np.log(fuel_kg_s), np.log(METER_KG_S), self.curve)


THE_SAME = Instruments({}, np.zeros(len(METER_KG_S)))
"""Of the engine that was identified."""


def calibrated(path: Path, state: Nominal, run: Run) -> Instruments:
    """Instruments of another engine, from records of a flight of its own that do not move."""
    from scipy.optimize import least_squares

    rows = run.thinned & ~run.moving & np.isfinite(run.measured).all(axis=1)
    model = Model(path, state, run, np.zeros(len(run.time)))
    begun = np.array([state.theta0[n] for n in INSTRUMENTS])
    sigma = np.array([steady_engine().parameters[n].prior_sigma for n in INSTRUMENTS])
    k, scale = len(INSTRUMENTS), SCALE * np.sqrt(REPEATS)
    x = np.log(run.measured[rows, 2])
    hats = METER_SIGMA * np.column_stack([np.interp(x, np.log(METER_KG_S), h) for h in np.eye(len(METER_KG_S))])

    def values(z: np.ndarray) -> dict[str, float]:
        return dict(zip(INSTRUMENTS, begun + sigma * z[:k], strict=True))

    def residual(z: np.ndarray) -> np.ndarray:
        e = model.errors(values(z), rows=rows)[0]
        e[:, 2] -= hats @ z[k:]
        return np.append(np.nan_to_num(e / scale, nan=ROBUST).ravel(), z)

    def slopes(z: np.ndarray) -> np.ndarray:
        J = np.zeros((int(rows.sum()), 3, len(z)))
        J[:, :, :k] = np.nan_to_num(model.errors(values(z), wrt=INSTRUMENTS, rows=rows)[1]) * sigma
        J[:, 2, k:] = -hats
        return np.concatenate([(J / scale[:, None]).reshape(-1, len(z)), np.eye(len(z))])

    found = least_squares(residual, np.zeros(k + len(METER_KG_S)), slopes, loss="huber", f_scale=ROBUST, ftol=1e-4)
    if not found.success:
        raise SystemExit(f"the instruments of the {run.side} engine did not converge: {found.message}")
    return Instruments(values(found.x), METER_SIGMA * found.x[k:])


def bled(flights: Path, run: Run, folder: Path) -> np.ndarray:
    """Where a flight's hidden switch is on (N,), as its steady records beside those of flight_ref show it: between them
    the state of the nearest; off on the ground, of which they say nothing."""
    if run.flight == REF:
        return np.zeros(len(run.time))
    evidence = load(flights, (REF, run.flight), run.side, nominal(folder, flights, run.side))
    found = search(evidence, run.side)
    first = found.first
    if first.states is None or first.switch_lr < max(first.threshold, first.continuous_lr):
        return np.zeros(len(run.time))
    own = found.of(Path(run.flight).name)
    at, states = stack_column(found.evidence, "time_s")[own], found.states[own]
    edges = 0.5 * (at[1:] + at[:-1])
    return states[np.searchsorted(edges, run.time)] * run.air


def errors_of(model: Model, instruments: Instruments) -> tuple[np.ndarray, float]:
    """Errors (N, 3) less the flight's offsets, with the bleed that leaves least in steady records, and its size."""
    run = model.run
    best, left, size = np.inf, np.empty(0), 0.0
    meter = instruments.meter(run.measured[:, 2])
    for bleed in BLEEDS if model.on.any() else BLEEDS[:1]:
        # a bleed is found from steady records; only the one found is put to all of them
        e = model.errors(instruments.values, float(bleed), rows=run.steady)[0]
        e[:, 2] -= meter[run.steady]
        cost = float(np.nanmean(robust((e - np.nanmedian(e, axis=0)) / STEADY_SCALE)))
        if cost < best:
            best, left, size = cost, np.nanmedian(e, axis=0), float(bleed)
    if size > 0.0:
        model.on = timed(model, instruments, left + np.stack([0.0 * meter, 0.0 * meter, meter], axis=1), size)
    e = model.errors(instruments.values, size)[0]
    e[:, 2] -= meter
    return e - left, size


def timed(model: Model, instruments: Instruments, off_by: np.ndarray, bleed: float) -> np.ndarray:
    """Where the bleed is on (N,), each change between two steady records at the second that leaves least there of
    errors beyond what instruments are off by (N, 3)."""
    run, on = model.run, model.on.copy()
    costs = []
    for state in (0.0, 1.0):
        model.on = np.full(len(on), state)
        costs.append(np.nansum(robust((model.errors(instruments.values, bleed)[0] - off_by) / SCALE), axis=1))
    at = np.flatnonzero(run.steady)
    for k in np.flatnonzero(np.diff(on[at])).tolist():
        rows, before = slice(at[k] + 1, at[k + 1]), int(on[at[k]])
        gain = np.append(0.0, np.cumsum(costs[before][rows] - costs[1 - before][rows]))
        on[rows] = np.where(np.arange(len(gain) - 1) < np.argmin(gain), before, 1 - before)
    return on


def robust(u: np.ndarray) -> np.ndarray:
    """u² up to ROBUST, beyond it by size."""
    u = np.abs(u)
    return np.where(u < ROBUST, u**2, 2.0 * ROBUST * u - ROBUST**2)


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


def judged(arms: Mapping[str, np.ndarray], run: Run) -> Judged:
    """RMS before and after over the moving, steady, and, with those on the ground, all moving records."""
    kinds = {"moving": run.moving & run.air, "steady": run.steady, "moving_with_ground": run.moving}
    return {k: {arm: rms(e, rows) for arm, e in arms.items()} for k, rows in kinds.items()}


def story(flights: Path, folder: Path, side: str = SIDES[0], others: Sequence[str] = (B22,)) -> dict[str, object]:
    """Coefficients of the engine that trained, and how it does on what trained it and on what did not."""
    path = moving_file(folder)
    trained = run_of(flights, REF, side)
    state = identified(trained, path)
    other = next(s for s in SIDES if s != side)
    own = {side: THE_SAME, other: calibrated(path, state, run_of(flights, REF, other))}
    names = [n for n in state.theta0 if n.split(".")[0] in {t["term"] for t in TERMS}]
    errors = {e.name: e.standard_error for e in state.estimates}
    there, bleeds = {}, {}
    for engine, flight in [(side, REF), *((side, f) for f in others), (other, REF), *((other, f) for f in others)]:
        run = run_of(flights, flight, engine)
        on = bled(flights, run, folder)
        steady = read_nominal(nominal(folder, flights, engine))
        before, _ = errors_of(Model(Path(ENGINE), steady, run, on), THE_SAME)
        after, bleed = errors_of(Model(path, state, run, on), own[engine])
        label = f"{engine}, {Path(flight).stem}"
        label = f"trained: {label}" if (engine, flight) == (side, REF) else label
        there[label], bleeds[label] = judged({"before": before, "after": after}, run), bleed
    return {
        "trained": f"{side}, {Path(REF).stem}",
        "coefficients": {n: [float(f"{state.theta0[n]:.4g}"), float(f"{errors[n]:.2g}")] for n in names},
        "instruments_of_the_other_engine": {n: float(f"{v:.4g}") for n, v in own[other].values.items()},
        "its_fuel_meter_pct": {
            f"{w:g} kg/s": round(100.0 * m, 1) for w, m in zip(METER_KG_S, own[other].curve, strict=True)
        },
        "bleed": {n: round(b, 3) for n, b in bleeds.items()},
        "rms": there,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--train", choices=SIDES, default=SIDES[0])
    parser.add_argument("--flight", action="append", default=[])
    parser.add_argument("--format", choices=("text", "json"), default="text")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        told = story(public_data("c550_jt15d"), Path(folder), given.train, given.flight or (B22,))
    if given.format == "json":
        print(json.dumps(told, indent=2))
        return
    print(", ".join(f"{n} {v:.3g} ± {s:.2g}" for n, (v, s) in told["coefficients"].items()) + "\n")
    print("| records | kind | N2, points | ITT, K | fuel flow, % |\n|---|---|---|---|---|")
    for where, kinds in told["rms"].items():
        for kind, arms in kinds.items():
            b, a = arms["before"], arms["after"]
            cells = (f"{b[q]:.3g} → {a[q]:.3g}" for q in ("N2_points", "ITT_K", "Wf_pct"))
            print(f"| {where} | {kind.replace('_', ' ')}, {a['records']} | " + " | ".join(cells) + " |")


if __name__ == "__main__":
    main()
