"""Realised false-alarm rates of `detect` over healthy windows: python tests/benchmarks/false_alarms.py [--windows N]

Linear-Gaussian twin of the whole chain with the sensitivities of the real engine along real flight phases: draw an
engine, identify its parameters and its noise from N records of one flight, judge windows of other flights. The engine
is called once; every window goes through the product's own statistics and test. A table goes to standard output, one
row per noise, nominal and phase: windows, and realised rate in % at nominal 5, 1 and 0.1 % with its 95 % interval:
binomial where the nominal is known; where windows share an identified nominal, from the scatter between nominals.

It judges with the doubt about an identified noise level (`NoiseModel.readings`), which the commands do not use yet: its
rows for identified nominals are not those of `enginediag detect`.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.signal import lfilter
from scipy.stats import beta

from enginediag_cli.detection.glr import critical_value
from enginediag_cli.engine import load_engine
from enginediag_cli.identification.noise import estimate_noise
from enginediag_cli.residuals.local import local_statistics, whiten
from enginediag_cli.residuals.noise import NoiseModel
from enginediag_cli.residuals.score import fisher_score, marginalise, score_map
from enginediag_cli.simulation.conditions import engine_inputs
from enginediag_cli.simulation.default_flight import default_plan
from enginediag_cli.simulation.flights import generate_flights

ROOT = Path(__file__).resolve().parents[2]
PHASES = ("ground", "climb", "cruise", "descent")
RATES = (0.05, 0.01, 0.001)
FLIGHTS = 12
GEOMETRIES = 4
"""Different stretches of a phase judged against each identified nominal."""


@dataclass(frozen=True)
class Flown:
    """Sensitivities J (N, m, p) of flown records, phase (N,) and flight (N,); sigma (m,); monitored names first."""

    J: np.ndarray
    phase: np.ndarray
    flight: np.ndarray
    sigma: np.ndarray
    prior: np.ndarray
    names: tuple[str, ...]
    monitored: tuple[str, ...]


def fly(engine_file: str | Path, seed: int = 1, flights: int = FLIGHTS) -> Flown:
    """Sensitivities of the engine along simulated flights to monitored, design and sensor parameters."""
    engine = load_engine(engine_file)
    given = generate_flights(default_plan(engine), engine, np.random.default_rng(seed), flights=flights)
    rest = [n for n, p in engine.parameters.items() if n not in engine.monitored and p.prior_sigma > 0]
    names = (*engine.monitored, *rest)
    found = engine.predict(engine_inputs(engine, given), wrt=names)
    ok = np.asarray(found.ok)
    return Flown(
        np.asarray(found.jacobian)[ok],
        np.asarray(given.columns["phase"])[ok],
        np.asarray(given.columns["flight"])[ok],
        np.array([s.noise_sigma for s in engine.sensors.values()]),
        np.array([engine.parameters[n].prior_sigma for n in names]),
        names,
        engine.monitored,
    )


def draw_noise(rng: np.random.Generator, kind: str, rho: float, shape: tuple[int, ...]) -> np.ndarray:
    """Unit-variance noise (..., n, m), correlated along n."""
    if kind == "uniform":
        return rng.uniform(-np.sqrt(3), np.sqrt(3), shape)
    white = rng.standard_normal(shape)
    if not rho:
        return white
    shocks = np.sqrt(1 - rho**2) * white
    shocks[..., 0, :] = white[..., 0, :]
    return np.asarray(lfilter([1.0], [1.0, -rho], shocks, axis=-2))


@dataclass(frozen=True)
class Identified:
    """Linear twin of a nominal file: error of the parameters (p,), its covariance, noise and how well it is known."""

    error: np.ndarray
    covariance: np.ndarray
    noise: NoiseModel


def identified(rng: np.random.Generator, flown: Flown, records: int, kind: str, rho: float) -> Identified:
    """Identify from every k-th of the records of flight 1, spread over all phases in one stretch of time each."""
    rows = _training(flown, records)
    J = flown.J[rows]
    truth = flown.prior * rng.standard_normal(len(flown.prior))
    e = J @ truth + flown.sigma * draw_noise(rng, kind, rho, (len(rows), len(flown.sigma)))
    kappa = np.full(len(flown.sigma), (1 + rho) / (1 - rho))
    label, floor = np.zeros(len(rows), int), 1e-6 * flown.sigma
    sigma, estimate = flown.sigma, np.zeros(len(truth))
    for _ in range(2):
        weight = 1 / (sigma * np.sqrt(kappa))
        G = (J * weight[:, None]).reshape(-1, J.shape[2])
        covariance = np.linalg.inv(G.T @ G + np.diag(flown.prior**-2.0))
        estimate = covariance @ (G.T @ (e * weight).ravel())
        used = np.sum(np.sum((G @ covariance) * G, axis=1).reshape(e.shape), axis=0)
        noise = estimate_noise(e - J @ estimate, label, used, floor)
        sigma, kappa = noise.sigma, noise.inflation
    model = NoiseModel(noise.sigma, noise.rho1, readings=np.maximum(noise.n - used * noise.inflation, 1.0))
    return Identified(truth - estimate, covariance, model)


def _training(flown: Flown, records: int) -> np.ndarray:
    """Record numbers of `records` consecutive records beginning on the ground, flight after flight."""
    return np.arange(min(records, len(flown.flight)))


def stretches(flown: Flown, phase: str, window: int) -> list[np.ndarray]:
    """Consecutive records of the phase in flights after the first two, `window` records each."""
    later = flown.flight.astype(float) > 2
    found = []
    rows = np.flatnonzero((flown.phase == phase) & later)
    breaks = np.flatnonzero(np.diff(rows) > 1) + 1
    for run in np.split(rows, breaks):
        found += [run[i : i + window] for i in range(0, len(run) - window + 1, window)]
    return found


def tested(
    rng: np.random.Generator, flown: Flown, phase: str, kind: str, rho: float, records: int | None, *,
    windows: int, length: int, missing: bool = False,
) -> tuple[np.ndarray, np.ndarray]:
    """Alarms (nominals, 3) at RATES, and windows (nominals,); records None: nominal and noise are known."""
    places = stretches(flown, phase, length)
    alarms: list[np.ndarray] = []
    judged: list[int] = []
    nominals = 1 if records is None else max(windows // 400, 1)
    m, p = len(flown.sigma), len(flown.names)
    while sum(judged) < windows:
        found = (
            Identified(np.zeros(p), np.zeros((p, p)), NoiseModel(flown.sigma, np.full(m, rho)))
            if records is None
            else identified(rng, flown, records, kind, rho)
        )
        alarms.append(np.zeros(len(RATES), int))
        judged.append(0)
        for _ in range(GEOMETRIES):
            rows = places[rng.integers(len(places))]
            count = min(-(-windows // (GEOMETRIES * nominals)), 5000)
            J = flown.J[rows].copy()
            if missing:  # two sensors not there at all, and one that drops out half way
                gone = rng.choice(m, 3, replace=False)
                J[:, gone[:2]], J[length // 2 :, gone[2]] = np.nan, np.nan
            alarms[-1] += _alarms(rng, flown, found, J, kind, rho, count)
            judged[-1] += count
    return np.array(alarms), np.array(judged)


def _alarms(
    rng: np.random.Generator, flown: Flown, found: Identified, J: np.ndarray, kind: str, rho: float, count: int
) -> np.ndarray:
    noise = found.noise
    geometry = local_statistics(
        np.zeros(J.shape[:2]), J, noise, parameters=flown.names, theta0=np.zeros(len(flown.names)),
        prior_sigma=flown.prior,
    )
    condensed = marginalise(geometry, flown.monitored, found.covariance)
    _, G = whiten(np.zeros(J.shape[:2]), J, noise)
    e = flown.sigma * draw_noise(rng, kind, rho, (count, *J.shape[:2])) + np.nan_to_num(J) @ found.error
    z = e / (noise.sigma * np.sqrt(noise.inflation))
    s = np.einsum("ckj,kjp->cp", z, G, optimize=True)
    b = s @ score_map(geometry, flown.monitored, found.covariance)[1].T
    score = fisher_score(condensed)  # of the windows, all but the score itself
    D = score.prior_sigma
    values, vectors = np.linalg.eigh(D[:, None] * score.information * D)
    kept = np.argsort(values)[len(values) - score.rank :]
    t = np.sum(((b * D) @ vectors[:, kept]) ** 2 / values[kept], axis=1)
    return np.array([int(np.sum(t > critical_value(score, rate))) for rate in RATES])


def row(name: str, alarms: np.ndarray, judged: np.ndarray, shared: bool) -> str:
    """A line of the table; shared: the windows of one nominal share its error."""
    cells = []
    total = int(judged.sum())
    for hits in alarms.T:
        k = int(hits.sum())
        low, high = beta.ppf(0.025, k, total - k + 1) if k else 0.0, beta.ppf(0.975, k + 1, total - k)
        if shared:
            error = 1.96 * np.std(hits / judged, ddof=1) / np.sqrt(len(judged))
            low, high = min(low, max(k / total - error, 0.0)), max(high, k / total + error)
        cells.append(f"{100 * k / total:.3f} ({100 * low:.3f}–{100 * high:.3f})")
    return f"| {name} | {total} | " + " | ".join(cells) + " |"


CASES = [
    *(("gaussian", 0.0, n) for n in (None, 100, 300, 1000)),
    *(("uniform", 0.0, n) for n in (None, 100, 1000)),
    *(("gaussian", 0.5, n) for n in (None, 300, 1000)),
    *(("gaussian", 0.9, n) for n in (None, 300, 1000)),
]


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--windows", type=int, default=100_000, help="windows per row")
    parser.add_argument("--length", type=int, default=30, help="records per window")
    parser.add_argument("--engine", default=str(ROOT / "configs" / "turbofan.yaml"))
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", default="", help="rows whose name contains this text")
    options = parser.parse_args(arguments)
    flown = fly(options.engine)
    print("| noise, nominal, phase | windows | at 5 % | at 1 % | at 0.1 % |\n|---|---|---|---|---|")
    for kind, rho, records in CASES:
        noise = kind if not rho else f"AR(1) ρ = {rho:g}"
        nominal = "known" if records is None else f"identified from {records} records"
        for phase in PHASES:
            for missing in (False, True) if phase == "cruise" else (False,):
                name = f"{noise}, {nominal}, {phase}" + (", sensors missing" if missing else "")
                if options.only not in name:
                    continue
                rng = np.random.default_rng([options.seed, *name.encode()])
                alarms, judged = tested(
                    rng, flown, phase, kind, rho, records, windows=options.windows, length=options.length,
                    missing=missing,
                )
                print(row(name, alarms, judged, records is not None), flush=True)


if __name__ == "__main__":
    sys.exit(main())
