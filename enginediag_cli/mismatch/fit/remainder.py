"""What a trial leaves to be explained: listed options and free curves, most surprising first, and the gates on them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from enginediag_cli.drivers import TIME
from enginediag_cli.engine.term import DriverValues
from enginediag_cli.mismatch.fit.believable import along_driver, with_belief
from enginediag_cli.mismatch.fit.columns import Columns
from enginediag_cli.mismatch.fit.families import Scored, correlations
from enginediag_cli.mismatch.fit.freeform import Cell, free_form, locations
from enginediag_cli.mismatch.fit.options import (
    EFFECT,
    FAULT,
    SENSOR_FAULT,
    Option,
    OptionScore,
    effects_of,
    option_scores,
    parameters_of,
)
from enginediag_cli.mismatch.fit.response import tolerated
from enginediag_cli.mismatch.fit.scores import critical_surprise
from enginediag_cli.mismatch.fit.trial import HypothesisFit
from enginediag_cli.parameters import Parameter
from enginediag_cli.progress import stage

SHARES = (0.5, 0.2, 0.3)
"""Of the probability of a false alarm: listed effects, changes in time, free form. What can be named is what is looked
for, and there are fewer of them."""
FAULTS = (FAULT, SENSOR_FAULT)


@dataclass(frozen=True)
class Gates:
    """Thresholds on −ln p of the most surprising effect, change in time and free-form block, at one level together."""

    effects: float = np.inf
    faults: float = np.inf
    cells: float = np.inf

    def of(self, option: Option) -> float:
        """That of a listed option."""
        return self.effects if option.kind == EFFECT else self.faults


@dataclass(frozen=True)
class Remainder:
    """What a trial leaves: scores of the other options and the free-form map, most surprising first."""

    scores: tuple[OptionScore, ...]
    cells: tuple[Cell, ...]

    @property
    def surprise(self) -> float:
        """−ln p of the most surprising thing that is left; infinite when nothing can be ranked (the model gave no
        derivatives at the fit), which must not pass for nothing left."""
        if self.unranked:
            return np.inf
        best = max((s.surprise for s in self.scores), default=0.0)
        return max(best, max((c.surprise for c in self.cells), default=0.0))

    @property
    def unranked(self) -> bool:
        """Whether nothing of what was looked for can be ranked."""
        return bool(self.scores or self.cells) and not self.blocks()

    @property
    def unseen(self) -> tuple[str, ...]:
        """Labels of the effects of which nothing can be ranked."""
        seen = {s.option.label for s in self.scores if not s.score.absorbed}
        of_effects = (s.option.label for s in self.scores if s.option.driver != TIME)
        return tuple(dict.fromkeys(label for label in of_effects if label not in seen))

    def over(self, gates: Gates) -> bool:
        """Whether anything that is left is significant."""
        return (
            self.best(EFFECT) > gates.effects
            or self.best(*FAULTS) > gates.faults
            or (max((c.surprise for c in self.cells), default=0.0) > gates.cells)
        )

    def best(self, *kinds: str) -> float:
        """Largest −ln p of the options of these kinds."""
        return max((s.surprise for s in self.scores if s.option.kind in kinds), default=0.0)

    def gates(self, levels: Sequence[float], rng: np.random.Generator) -> tuple[Gates, ...]:
        """Gates at each level, which the three families share by SHARES."""
        scores = [s for s in self.scores if not s.score.absorbed]
        families: tuple[list[Scored], ...] = (
            list[Scored](s for s in scores if s.option.kind == EFFECT),
            list[Scored](s for s in scores if s.option.kind != EFFECT),
            list[Scored](c for c in self.cells if not c.score.absorbed),
        )
        found = [
            critical_surprise(*correlations(blocks), [share * level for level in levels], rng)
            for blocks, share in zip(families, SHARES, strict=True)
        ]
        return tuple(Gates(*g) for g in zip(*found, strict=True))

    def tolerant(self, share: float) -> Remainder:
        """What is left beyond a non-centrality of `share`."""
        return Remainder(
            tuple(replace(s, score=tolerated(s, share)) for s in self.scores),
            tuple(replace(c, score=tolerated(c, share)) for c in self.cells),
        )

    def judged_by(self, gates: Gates) -> list[tuple[Scored, float]]:
        """Everything that was looked for, with its gate."""
        of = [(s, gates.of(s.option)) for s in self.scores if s.feasible]
        return [*of, *((c, gates.cells) for c in self.cells)]

    def blocks(self) -> list[Scored]:
        """Everything that can be ranked."""
        return [b for b in (*self.scores, *self.cells) if not b.score.absorbed]

    def beside_noise(self) -> list[Scored]:
        """The same but for effects that go by readings as they were measured: some of these together are a reading's
        noise, which then would be explained."""
        return [b for b in self.blocks() if not (isinstance(b, OptionScore) and _goes_by_readings(b.option))]


def _goes_by_readings(option: Option) -> bool:
    return any(e.term.MEASURED for e in option.hypothesis.effects)


@stage("scoring effects")
def remainder(
    trial: HypothesisFit, library: Sequence[Option], drivers: Sequence[DriverValues], enough: Gates | None = None
) -> Remainder:
    """Scores of what the trial does not carry; drivers are over the records of the evidence. The map is left out where
    an option is already over the gates `enough`."""
    found, where = trial.found, locations(trial.found)
    names = [*parameters_of(library), *(p.parameter for p in where)]
    columns = Columns(found, names, [*effects_of(library), *(p.through for p in where if p.through is not None)])
    scores = sorted(option_scores(found, trial.projection, library, columns), key=lambda s: -s.surprise)
    left = Remainder(tuple(scores), ())
    if enough is not None and left.over(enough):
        return left
    parameters = found.evidence.engine.parameters
    cells = [_believed(c, parameters) for c in free_form(found, trial.projection, drivers, columns)]
    return Remainder(tuple(scores), tuple(sorted(cells, key=lambda c: -c.surprise)))


def _believed(cell: Cell, parameters: Mapping[str, Parameter]) -> Cell:
    """The cell judged with a prior on how far its place may vary: what is beyond belief does not stand out."""
    scale = along_driver(cell.location, parameters)
    return replace(
        cell, score=with_belief(cell.score, cell.sums.gram(cell.candidates), cell.sums.pulls(cell.candidates), scale)
    )
