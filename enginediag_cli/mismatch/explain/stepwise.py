"""Sets of options that act together, where no single one explains the evidence."""

from __future__ import annotations

from collections.abc import Sequence

from enginediag_cli.drivers import TIME
from enginediag_cli.mismatch.explain.answer import Explanation
from enginediag_cli.mismatch.explain.judging import Fits
from enginediag_cli.mismatch.explain.pairs import best_pairs
from enginediag_cli.mismatch.fit.freeform import Cell
from enginediag_cli.mismatch.fit.options import Option, OptionScore, with_best_onset
from enginediag_cli.mismatch.fit.trial_fit import Trial, remainder

PAIRS = 4
"""Pairs that are refitted, best by score first, as of single options (`SHORTLIST`)."""
LARGEST_SET, EXTENDED = 4, 2
"""Options that may act together at most, and how many of the best singles or sets are extended by one more. Judgement:
more together is better told as unlisted physics."""


def named_sets(
    fits: Fits, singles: Sequence[Trial], scores: Sequence[OptionScore], best: Cell | None
) -> list[Explanation]:
    """The alias set of pairs, or of the larger sets that grow from them; empty when none is adequate. `singles`: the
    fitted single options, best first; `scores` of all at the base; `best`: the free-form block that a set must beat."""
    pairs: list[tuple[Option, ...]] = []
    for found in best_pairs(scores, PAIRS):
        _add(pairs, tuple(map(fits.timed, found)))
    for wider in forward(fits, singles[:EXTENDED]):
        _add(pairs, wider)
    sets = fits.refit(pairs) or []
    for size in range(2, LARGEST_SET + 1):
        named = fits.named([s for s in sets if fits.counts(s, best)])
        if named or size == LARGEST_SET:
            return named
        sets = fits.refit(_extended(fits, sets[:EXTENDED])) or []
    return []


def forward(fits: Fits, singles: Sequence[Trial]) -> list[tuple[Option, ...]]:
    """Each single option with the effect, and with the change in time, that says most about what it leaves."""
    wider: list[tuple[Option, ...]] = []
    for trial in singles:
        left = remainder(trial, fits.library, ())
        for timed in (False, True):
            best = next((s for s in left.scores if (s.option.driver == TIME) == timed and s.surprise > 0.0), None)
            if best is not None:
                _add(wider, (*trial.options, with_best_onset(trial.found, trial.projection, best.option)))
    return wider


def _extended(fits: Fits, sets: Sequence[Trial]) -> list[tuple[Option, ...]]:
    """Each set with the effect of the same driver that has most to say about what the set leaves: more than two
    things are one cause that acts at several places, or a fit to chance."""
    wider: list[tuple[Option, ...]] = []
    for trial in sets:
        driver = {o.driver for o in trial.options}
        if len(driver) == 1 and TIME not in driver:
            left = remainder(trial, [o for o in fits.library if o.driver in driver], ())
            if left.scores and left.scores[0].surprise > fits.adequate.effects:
                _add(wider, (*trial.options, left.scores[0].option))
    return wider


def _add(sets: list[tuple[Option, ...]], new: tuple[Option, ...]) -> None:
    """Adds a set that is not there yet, in whatever order."""
    if not any({o.label for o in new} == {o.label for o in other} for other in sets):
        sets.append(new)
