"""A study cut into batches that do not depend on each other: what a process works on."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from time import process_time

import numpy as np

from enginediag_cli.methods.base import FittedMethod, Windows
from enginediag_cli.methods.evidence import Evidence
from enginediag_cli.validation.studies.answers import answers_of
from enginediag_cli.validation.studies.flown import make_trials
from enginediag_cli.validation.studies.study_file import Study, load_study
from enginediag_cli.validation.studies.tally import Tally, tally

BATCH_RECORDS = 10_000
"""Records of a batch: one call of the engine for all of them hides the overhead of calls."""
TRAINING_RECORDS = 6_000
"""Healthy records that methods learn from."""
TRAINING_KEY = 2**31
"""Key of the random stream of these records, apart from those of all cases."""


@dataclass(frozen=True, order=True)
class Batch:
    """Repetitions `first` … `first + count − 1` of case number `case`."""

    case: int
    first: int
    count: int


def batches(study: Study, repetitions: int | None = None) -> tuple[Batch, ...]:
    """The whole study; `repetitions` replaces those of every case. Does not depend on who does the work."""
    size = max(BATCH_RECORDS // study.records, 1)
    found = []
    for k, case in enumerate(study.cases):
        total = repetitions or case.repetitions
        found += [Batch(k, first, min(size, total - first)) for first in range(0, total, size)]
    return tuple(found)


class Laboratory:
    """A study with its engine, and its methods once they are trained."""

    def __init__(self, study: Study, seed: int):
        self.study, self._seed = study, seed
        self._trained: dict[str, FittedMethod] = {}

    def run(self, batch: Batch) -> dict[str, Tally]:
        """Tally of every method, by its name."""
        study, case = self.study, self.study.cases[batch.case]
        trained = self.trained()  # learning is not part of a diagnosis
        self._forget()
        rng = np.random.default_rng(np.random.SeedSequence(self._seed, spawn_key=(batch.case, batch.first)))
        trials = make_trials(study.monitor, case, batch.count, study.records, study.plan, study.noise, rng)
        faults = np.count_nonzero(trials.changes, axis=1)
        evidence = Evidence(trials.windows.inputs, trials.windows.y, study.monitor, faults)
        result = {}
        for name, method in trained.items():
            evidence.used.clear()
            before, begun = sum(evidence.cost.values()), process_time()
            verdicts = method.diagnose(evidence, study.false_alarm)
            own = process_time() - begun - (sum(evidence.cost.values()) - before)
            seconds = own + sum(evidence.cost[what] for what in evidence.used)
            answers = answers_of(verdicts, study.monitor.names)
            result[name] = tally(trials.changes, answers, seconds, trials.failed)
        return result

    def trained(self) -> dict[str, FittedMethod]:
        """Every method by its name in the study, trained once on healthy windows of the study."""
        if not self._trained:
            methods = self.study.methods
            healthy = self._healthy() if any(method.learns for method in methods.values()) else None
            self._trained = {name: method.train(self.study.monitor, healthy) for name, method in methods.items()}
        return self._trained

    def _healthy(self) -> Windows:
        from enginediag_cli.validation.studies.cases import healthy_case

        study = self.study
        count = max(TRAINING_RECORDS // study.records, 2)
        rng = np.random.default_rng(np.random.SeedSequence(self._seed, spawn_key=(TRAINING_KEY,)))
        case = healthy_case(study.monitor, count)
        return make_trials(study.monitor, case, count, study.records, study.plan, study.noise, rng).windows

    def _forget(self) -> None:
        """The engine begins every batch as if newly loaded, so that no result depends on what was done before."""
        self.study.monitor.engine.forget_start()  # type: ignore[attr-defined]


@lru_cache(maxsize=1)
def laboratory(path: Path, seed: int) -> Laboratory:
    """The laboratory of this process."""
    return Laboratory(load_study(path), seed)


def run_batch(path: Path, seed: int, batch: Batch) -> dict[str, Tally]:
    """One batch of the study at `path`; what a worker process is asked for."""
    return laboratory(path, seed).run(batch)
