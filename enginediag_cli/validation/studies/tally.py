"""Counts of one case and method. Tallies of two batches add up, so batches may run anywhere and in any order."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from enginediag_cli.validation.studies.answers import Answers

EDGES = np.array([0.0, 0.15, 0.25, 0.35, 0.45, 0.55, 0.65, 0.75, 0.85, 0.95, 1.0 + 1e-9])
"""Bins of stated probability, centred at 0.2, 0.3 … 0.9, with one below and one above."""

BLOCK = ("repetitions", "unchanged", "detected", "false_alarms", "exact", "contained")
"""Counts that every batch keeps of its own."""


@dataclass(frozen=True)
class Tally:
    """What became of `repetitions` diagnoses.

    judged: had a verdict; unchanged: nothing was wrong; false_alarms: of these, detected; exact: exactly the
    changed parameters isolated; contained: all of them and perhaps more; right_size: as many isolated as changed;
    isolated: parameters isolated in total; counts (p,): in how many answers each parameter is; counts_contained
    (p,): the same among the answers that contain all changed parameters; failed_records: not computed by the
    engine; seconds: CPU time of diagnosis; bins (bins, 3): answers, right answers and sum of stated probabilities;
    blocks (B, 6): counts of each batch that was added, as BLOCK names them, whose operating points were drawn together.
    `isolates`: the method names parameters.
    """

    repetitions: int
    judged: int
    unchanged: int
    detected: int
    false_alarms: int
    exact: int
    contained: int
    right_size: int
    isolated: int
    counts: np.ndarray
    counts_contained: np.ndarray
    failed_records: int
    seconds: float
    bins: np.ndarray
    isolates: bool
    blocks: np.ndarray

    def __add__(self, other: Tally) -> Tally:
        both: dict[str, Any] = {f.name: getattr(self, f.name) + getattr(other, f.name) for f in fields(self)[:-1]}
        both["isolates"] = self.isolates and other.isolates
        return Tally(**both, blocks=np.concatenate([self.blocks, other.blocks]))

    def of_blocks(self, name: str) -> np.ndarray:
        """Counts (B,) of each batch."""
        return np.asarray(self.blocks[:, BLOCK.index(name)])

    def as_json(self) -> dict[str, Any]:
        """Plain numbers and lists."""
        return {
            f.name: getattr(self, f.name).tolist()
            if isinstance(getattr(self, f.name), np.ndarray)
            else getattr(self, f.name)
            for f in fields(self)
        }

    @classmethod
    def from_json(cls, values: Mapping[str, Any]) -> Tally:
        """Inverse of `as_json`; raises TypeError or KeyError for something else."""
        arrays = ("counts", "counts_contained", "bins", "blocks")
        given: dict[str, Any] = {f.name: values[f.name] for f in fields(cls)}
        given.update({name: np.array(given[name]) for name in arrays})
        return cls(**given)


def tally(changes: np.ndarray, answers: Answers, seconds: float, failed_records: int) -> Tally:
    """Count the answers on windows with true `changes` (W, p)."""
    truth = changes != 0
    W, p = truth.shape
    found = np.zeros((W, p), bool) if answers.isolated is None else answers.isolated
    named = np.full(W, answers.isolated is not None) & answers.judged
    exact = named & np.all(found == truth, axis=1)
    contained = named & np.all(found | ~truth, axis=1)
    unchanged = ~truth.any(axis=1)
    detected = answers.judged & answers.detected
    bins = np.zeros((len(EDGES) - 1, 3))
    stated = named & np.isfinite(answers.probability)
    place = np.digitize(answers.probability[stated], EDGES) - 1
    np.add.at(bins, place, np.column_stack([np.ones(stated.sum()), exact[stated], answers.probability[stated]]))
    false_alarms = detected & unchanged
    block = [W, *(int(x.sum()) for x in (unchanged, detected, false_alarms, exact, contained))]
    return Tally(
        W,
        int(answers.judged.sum()),
        int(unchanged.sum()),
        int(detected.sum()),
        int(false_alarms.sum()),
        int(exact.sum()),
        int(contained.sum()),
        int((named & (found.sum(axis=1) == truth.sum(axis=1))).sum()),
        int(found[named].sum()),
        found[named].sum(axis=0),
        found[contained].sum(axis=0),
        failed_records,
        seconds,
        bins,
        answers.isolated is not None,
        np.array([block]),
    )
