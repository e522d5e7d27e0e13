"""What the search makes of effects concealed in recordings of a simulator that is not ours (pyCycle 4.4).

`python tests/verification/pycycle_concealed.py` prints, for each recording: what is missing and where, the fit before
and after, on readings that were not used, and only then the answer; `--table` the same as a Markdown table. The search
sees the recordings and the engine file; the answers are opened by `opened` afterwards. Sensor noise of 0.05 to 0.3 % is
added here; the stated map accuracy is the default, since this engine model is not that simulator (0.26 % apart).
"""

from __future__ import annotations

import csv
import sys
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pycycle_hbtf
import shared_data
import yaml

from enginediag_cli.config.files import outside_allowed
from enginediag_cli.engine.engine import Engine
from enginediag_cli.mismatch.explain.answer import HIDDEN_STATE, IDENTIFIED, Answer
from enginediag_cli.mismatch.explain.explain import Search
from enginediag_cli.mismatch.explain.unrecorded_search import hidden_search
from enginediag_cli.mismatch.fit.evidence import Dataset, Flight, Noise, Settings
from enginediag_cli.mismatch.fit.held_out import held_out_objectives
from enginediag_cli.mismatch.fit.identified import NULL_HYPOTHESIS, identify_with
from enginediag_cli.mismatch.fit.options import combine_options
from enginediag_cli.mismatch.fit.projection import Projection
from enginediag_cli.mismatch.unrecorded.hidden import hidden_amplitudes
from enginediag_cli.physics.engine_file import load_engine

FOLDER = shared_data.DATA / "pycycle_hbtf"
RECORDINGS = ("nominal", "fault_1", "fault_2", "concealed_1", "concealed_2", "concealed_3")
NOISE = {
    "N2_rpm": 0.0005,
    "Wf_kg_s": 0.003,
    "T13_K": 0.001,
    "P13_Pa": 0.001,
    "T25_K": 0.001,
    "P25_Pa": 0.001,
    "T3_K": 0.001,
    "P3_Pa": 0.001,
    "T45_K": 0.0015,
    "P45_Pa": 0.001,
    "T5_K": 0.0015,
    "P5_Pa": 0.001,
}
"""Standard deviation of one reading over its mean."""

FLIGHTS = 4
UNUSED = ("T45_K", "T5_K")
"""Readings by which an amplitude estimated from the others is judged."""


@dataclass(frozen=True)
class Found:
    """The search's answer; χ² per reading on readings that were not used, before and after; the amplitude in every
    record (N,) where the driver is not recorded."""

    answer: Answer
    before: float
    after: float
    amplitude: np.ndarray | None = None


def columns(name: str, folder: Path = FOLDER) -> dict[str, np.ndarray]:
    with (folder / f"{name}.csv").open() as f:
        rows = list(csv.DictReader(f))
    return {k: np.array([float(r[k]) for r in rows]) for k in rows[0]}


def engine(scratch: Path) -> Engine:
    """The engine file from the published design data, with the recorded sensors."""
    declared = pycycle_hbtf.engine_file(FOLDER, scratch)
    healthy = columns("nominal")
    declared["sensors"] = {c: {"noise_sigma": float(s * np.mean(healthy[c]))} for c, s in NOISE.items()}
    declared["monitored"] = [
        f"{c}.{q}" for c in ("fan", "lpc", "hpc", "hpt", "lpt") for q in ("efficiency", "flow_capacity")
    ]
    path = scratch / "hbtf.yaml"
    path.write_text(yaml.safe_dump(declared, sort_keys=False))
    with outside_allowed():  # its maps lie beside the public cases
        return load_engine(path)


def evidence(of: Engine, name: str, seed: int = 0) -> Dataset:
    """The recording with noise, its records dealt to four flights in turn."""
    recorded, rng = columns(name), np.random.default_rng(seed)
    for c in of.sensors:
        recorded[c] = recorded[c] + of.sensors[c].noise_sigma * rng.standard_normal(len(recorded[c]))
    flights = tuple(
        Flight(f"{name} {k + 1}", "", {c: v[k::FLIGHTS] for c, v in recorded.items()}) for k in range(FLIGHTS)
    )
    nuisance = {n: 0.02 for n in of.monitored} | {f"sensor.{s.quantity}.scale": 0.002 for s in of.sensors.values()}
    return Dataset(of, flights, Noise({c: s.noise_sigma for c, s in of.sensors.items()}), Settings(nuisance))


def search(given: Dataset) -> Found:
    s = Search(given, hidden=hidden_search(given))
    answer = s.run()
    n = len(s.base.projection.frame.record)
    before = float(held_out_objectives(s.base.projection).sum()) / n
    if answer.status == IDENTIFIED:
        fit = identify_with(given, combine_options(*answer.explanations[0].options), s.along, s.base.found)
        return Found(answer, before, float(held_out_objectives(Projection(fit)).sum()) / n)
    if answer.status == HIDDEN_STATE:
        return Found(answer, *_sensors_left_out(given, s, answer.hidden[0].location.name))
    return Found(answer, before, before)


def _sensors_left_out(given: Dataset, s: Search, place: str) -> tuple[float, float, np.ndarray]:
    """χ² per reading of the unused sensors without and with the amplitude that the other sensors give, after the best
    constant offset of each sensor, and that amplitude in the order of the recording."""
    others = {c: x for c, x in given.noise.sigma.items() if c not in UNUSED}
    less = replace(given, noise=Noise(others))
    base = identify_with(less, NULL_HYPOTHESIS, s.along)
    found = hidden_amplitudes(base, Projection(base), level=0.05, rng=np.random.default_rng(0))
    first = next(f for f in found if f.location.name == place)
    where = first.location
    model = given.engine.replace_effects([where.through] if where.through else [])
    u = base.problem.inputs
    theta = {k: v for k, v in base.theta.items() if k in model.parameters}
    at = theta.get(where.parameter, model.parameters[where.parameter].nominal)
    inputs = {c: u[c] for c in model.inputs}
    y = [
        model.predict(inputs, theta | {where.parameter: at + a}, sensors=UNUSED).y
        for a in (0.0, np.clip(first.amplitude, -at, None) if where.through is None else first.amplitude)
    ]
    measured = np.column_stack([np.concatenate([f.columns[c] for f in given.flights]) for c in UNUSED])
    sigma = np.array([given.noise.sigma[c] for c in UNUSED])
    chi2 = []
    for predicted in y:
        e = (measured[first.number] - predicted) / sigma
        e = e - np.nanmean(e, axis=0)
        chi2.append(float(np.nanmean(e**2)))
    size = len(given.flights[0].columns["mach"])
    order = (first.number % size) * FLIGHTS + first.number // size
    amplitude = np.full(FLIGHTS * size, np.nan)
    amplitude[order] = first.amplitude
    return chi2[0], chi2[1], amplitude


def opened(name: str) -> dict[str, np.ndarray]:
    """The sealed answer of a recording."""
    return columns(name, FOLDER / "answers")


def row(name: str, found: Found) -> str:
    """The recording's row of the Markdown table."""
    a, truth, healthy = found.answer, opened(name), opened("nominal")
    changed = {k: v for k, v in truth.items() if np.abs(v - healthy[k][0]).max() > 0}
    answer = "nothing is missing"
    if a.status == IDENTIFIED:
        answer = "; ".join(
            ", ".join(f"{c.name} {c.value:.3f} ± {c.standard_error:.3f}" for c in x.coefficients)
            for x in a.explanations
        )
    elif a.status == HIDDEN_STATE:
        first, second = a.hidden[:2]
        answer = (
            f"an unrecorded driver at {first.location.name} (ln likelihood ratio {first.gain:.0f}; next "
            f"{second.location.name}, {second.gain:.0f})"
        )
    r = [
        np.corrcoef(found.amplitude[good], v[good])[0, 1]
        for v in changed.values()
        if found.amplitude is not None and np.ptp(v) > 0
        for good in [np.isfinite(found.amplitude)]
    ]
    told = ", ".join(
        f"{k} {v[0]:g}" if np.ptp(v) == 0 else f"{k} {v.min():.3g} to {v.max():.3g}" for k, v in changed.items()
    )
    misfit = f"{found.before:.2f} → {found.after:.2f}" if a.status in (IDENTIFIED, HIDDEN_STATE) else "–"
    return f"| `{name}` | {answer} | {told or 'nothing'} | {misfit} | {f'{r[0]:.3f}' if r else '–'} |"


def table(names: list[str], of: Engine) -> None:
    print(
        "| recording | answer of the search | what was concealed | χ² per reading not used, before → after "
        "| correlation with the truth |\n|---|---|---|---|---|"
    )
    for name in names:
        print(row(name, search(evidence(of, name))), flush=True)


def main() -> None:
    if not shared_data.available("pycycle_hbtf"):
        sys.exit(shared_data.reason("pycycle_hbtf"))
    with tempfile.TemporaryDirectory() as scratch:
        of = engine(Path(scratch))
        names = [a for a in sys.argv[1:] if not a.startswith("-")] or list(RECORDINGS)
        if "--table" in sys.argv:
            return table(names, of)
        for name in names:
            found = search(evidence(of, name))
            a, truth = found.answer, opened(name)
            print(f"{name}: {a.status}. {a.reason}")
            for x in a.explanations:
                values = ", ".join(f"{c.name} {c.value:.3f} ± {c.standard_error:.3f}" for c in x.coefficients)
                print(f"  {100 * x.probability:.0f} %: {values}")
            for h in a.hidden[: 3 * (a.status == HIDDEN_STATE)]:
                print(f"  {h.location.name}: ln likelihood ratio {h.lr:.0f}, after refit {h.gain:.0f}")
            if a.status in (IDENTIFIED, HIDDEN_STATE):
                print(f"  χ² per reading that was not used: {found.before:.2f} before, {found.after:.2f} after")
            healthy = opened("nominal")
            changed = {k: v for k, v in truth.items() if np.abs(v - healthy[k][0]).max() > 0}
            for k, v in changed.items():
                told = f"{v[0]:g}" if np.ptp(v) == 0 else f"{v.min():g} to {v.max():g}, from record to record"
                print(f"  answer: {k} = {told} (nominal {healthy[k][0]:g})")
                if found.amplitude is not None and np.ptp(v) > 0:
                    good = np.isfinite(found.amplitude)
                    r = np.corrcoef(found.amplitude[good], v[good])[0, 1]
                    print(f"  correlation of the estimate with it: {r:.3f}")


if __name__ == "__main__":
    main()
