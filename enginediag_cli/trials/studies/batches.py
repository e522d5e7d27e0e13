"""A study cut into batches that do not depend on each other: what a process works on."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from time import process_time

import numpy as np

from enginediag_cli.methods.evidence import Evidence
from enginediag_cli.methods.families.base import FittedFamily, Windows
from enginediag_cli.methods.registry import METHODS
from enginediag_cli.trials.studies.flown import make_trials
from enginediag_cli.trials.studies.study_file import Study, load_study
from enginediag_cli.trials.studies.tally import Tally, tally

BATCH_RECORDS = 10_000
"""Records of a batch: one call of the engine for all of them hides the overhead of calls."""
TRAINING_RECORDS = 6_000
"""Healthy records that families of residuals learn from."""
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
    """A study with its engine, and the families of residuals trained so far."""

    def __init__(self, study: Study, seed: int):
        self.study, self._seed = study, seed
        self._trained: dict[str, FittedFamily] = {}

    def run(self, batch: Batch) -> dict[str, Tally]:
        """Tally of every method, by its name."""
        study, case = self.study, self.study.cases[batch.case]
        self._forget()
        rng = np.random.default_rng(np.random.SeedSequence(self._seed, spawn_key=(batch.case, batch.first)))
        trials = make_trials(study.monitor, case, batch.count, study.records, study.plan, study.noise, rng)
        faults = np.count_nonzero(trials.changes, axis=1)
        evidence = Evidence(study.monitor, trials.windows, faults, study.false_alarm, self.trained)
        result = {}
        for name, options in study.methods.items():
            if options["type"] == "family":
                self.trained(options["family"])  # learning is not part of a diagnosis
            evidence.used.clear()
            before, begun = sum(evidence.cost.values()), process_time()
            answers = METHODS[options["type"]](evidence, options)
            own = process_time() - begun - (sum(evidence.cost.values()) - before)
            seconds = own + sum(evidence.cost[what] for what in evidence.used)
            result[name] = tally(trials.changes, answers, seconds, trials.failed)
        return result

    def trained(self, family: str) -> FittedFamily:
        """The family of this name, trained once on healthy windows of the study."""
        if family not in self._trained:
            from enginediag_cli.methods.families.registry import FAMILIES

            choice = FAMILIES[family]()
            self._trained[family] = choice.train(self.study.monitor, self._healthy() if choice.learns else None)
            self._forget()
        return self._trained[family]

    def _healthy(self) -> Windows:
        from enginediag_cli.trials.studies.cases import healthy_case

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
