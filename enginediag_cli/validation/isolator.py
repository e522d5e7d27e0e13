"""The isolator of blind trials: a process of its own that knows nothing but the files that it is asked about.

    python -m enginediag_cli.validation.isolator [PARENT]

It identifies and isolates as the commands do when no option is given: `identify ENGINE HEALTHY... -o NOMINAL`, then
`isolate -n NOMINAL JUDGED`. One JSON object a line on standard input: paths of an engine file, of the healthy
recordings and of the one to be judged. One JSON object a line on standard output: the answer. Changes are told by
place: the name of a parameter of the engine, or `reading` and the column of an instrument that is wrong.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from time import process_time
from typing import Any

from enginediag_cli.engine.engine import Engine
from enginediag_cli.identification.identify import identify
from enginediag_cli.identification.nominal_file import write_nominal
from enginediag_cli.identification.problem import without_repeats
from enginediag_cli.intake.loader import Intake, whole_flights
from enginediag_cli.intake.selection import Source, columns_of, open_baseline
from enginediag_cli.isolation.diagnosis import DiagnosisOptions
from enginediag_cli.isolation.windows import IsolatedWindow, Isolating
from enginediag_cli.parameters import Parameter
from enginediag_cli.physics.engine_file import load_engine
from enginediag_cli.recordings.provenance import sha256_of
from enginediag_cli.residuals.files import JudgedFiles
from enginediag_cli.residuals.long_windows import KeptRecords
from enginediag_cli.residuals.monitor import monitor_of
from enginediag_cli.units import split_column
from enginediag_cli.validation.isolation_truths import reading
from enginediag_cli.validation.trials import answer_questions

NOMINAL = "nominal.yaml"
FALSE_ALARM = 0.01
"""What `isolate` tests by when nobody chooses."""


@dataclass(frozen=True)
class Identified:
    """What `identify` made of healthy recordings: the nominal file, None where it did not converge."""

    engine: Engine
    nominal: Path | None
    reason: str
    seconds: float


@lru_cache(maxsize=1)
def identified(engine_path: Path, healthy: tuple[str, ...]) -> Identified:
    """The engine identified on these files; kept while questions are about the same ones."""
    begun = process_time()
    engine = load_engine(engine_path)
    intake = Intake(Source(healthy), columns_of(engine))
    training, _ = without_repeats([f.recording for f in whole_flights(intake)], (*engine.inputs, *engine.sensors))
    found = identify(engine, training)
    path = None
    if found.converged:
        path = engine_path.parent / NOMINAL
        # whether it is smooth, which `identify` finds out as well, is asked by `detect` alone
        write_nominal(found.nominal(engine_path.name, sha256_of(engine_path), {}), str(path))
    return Identified(engine, path, found.reason, process_time() - begun)


def answer(question: Mapping[str, Any]) -> dict[str, Any]:
    """What is said of the recording that is to be judged."""
    begun = process_time()
    found = identified(Path(question["engine"]), tuple(question["healthy"]))
    told: dict[str, Any] = {"identified": found.nominal is not None, "reason": found.reason}
    if found.nominal is not None:
        told["windows"] = [_window(w, found.engine) for w in _windows(found.nominal, question["judged"])]
    return told | {"identify_seconds": found.seconds, "seconds": process_time() - begun}


def _windows(nominal: Path, judged: str) -> Sequence[IsolatedWindow]:
    monitor = monitor_of(open_baseline(nominal), sensors=True, drifts=True)
    files = JudgedFiles(Intake(Source((judged,)), columns_of(monitor.engine, monitor.sensors)), monitor)
    kept = KeptRecords(monitor, short_windows=False)
    return list(Isolating(files, DiagnosisOptions(), FALSE_ALARM, kept=kept).windows())


def _window(found: IsolatedWindow, engine: Engine) -> dict[str, Any]:
    """The answer for one window: verdict, sets of places with their probabilities (the answer first, with the
    instruments that are stuck or scatter), sizes; `changed`: of each place of the answer the probability that it
    changed, whatever else did."""
    told: dict[str, Any] = {"verdict": found.verdict.with_instruments, "why": found.verdict.reason}
    told["named"] = found.named
    if found.diagnosis is None:
        return told
    result, place = found.diagnosis.result, _places(found.known, engine)
    sets = [(result.isolated, result.probability), *((r.parameters, r.probability) for r in result.rivals)]
    told["stands"] = found.diagnosis.adequacy.stands
    told["fit"] = _finite(found.diagnosis.adequacy.fit)
    told["sets"] = [[place[n] for n in names] for names, _ in sets]
    told["sets"][0] += [reading(fault.column) for fault in found.instruments]
    told["probabilities"] = [_finite(p) for _, p in sets]
    told["changed"] = [_finite(result.inclusion[n]) for n in result.isolated]
    told["changed"] += [_finite(fault.probability) for fault in found.instruments]
    one_of = getattr(result, "one_of", None)  # the class of which the answer is a member, where it cannot be told apart
    if one_of is not None:
        told["class"] = [[place[n] for n in (*one_of.shared, *member)] for member in one_of.members]
        told["class_probability"] = _finite(one_of.probability)
    told["left_out"] = result.rivals_left_out
    told["complete"] = result.complete
    told["sizes"] = [
        [place[s.parameter], found.known[s.parameter].quantity, float(s.change), _finite(s.lower), _finite(s.upper)]
        for s in result.sizes
    ]
    return told


def _places(known: Mapping[str, Parameter], engine: Engine) -> dict[str, str]:
    """Place of each parameter: its name, or of an instrument's error its column."""
    column = {f"sensor.{s.quantity}": c for c, s in engine.sensors.items()}
    column |= {f"input.{split_column(c)[0]}": c for c in (*engine.inputs, *engine.optional_inputs)}
    return {n: reading(column[p.component]) if p.component in column else n for n, p in known.items()}


def _finite(x: float) -> float | None:
    return float(x) if abs(float(x)) < float("inf") else None


if __name__ == "__main__":
    answer_questions(answer)
