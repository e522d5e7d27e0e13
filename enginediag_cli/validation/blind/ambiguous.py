"""What is concealed in a trial of planning: an effect that the first flights show, but cannot tell from others.

The first flights are recorded in cruise alone, as many an airline records them. Drawn again until there is such a
rival, from random numbers of its own.
"""

from __future__ import annotations

from dataclasses import replace

from enginediag_cli.engine.engine import Engine
from enginediag_cli.mismatch.explain.judging import ALIAS
from enginediag_cli.physics.engine_file import load_engine
from enginediag_cli.validation.blind import kinds
from enginediag_cli.validation.blind.opened import evidence_of
from enginediag_cli.validation.blind.recorded import record
from enginediag_cli.validation.blind.sealed import Sealed, draw
from enginediag_cli.validation.blind.separability import separability
from enginediag_cli.validation.blind.visible import VISIBLE

RECORDED = (0.3, 0.75)
"""Share of a flight, from and to, that is recorded before the plan: its cruise."""
MOST_DRAWS = 80
"""Draws of a trial: one in eight is ambiguous with exact maps, one in thirty with wrong ones."""
FURTHER_DRAWS = 1_000_000
"""Draw k of trial t is draw t + k FURTHER_DRAWS of the seed: no trial of its own."""


def draw_ambiguous(path: str, seed: int, trial: int, truth: str) -> Sealed:
    """A visible single effect with at least one rival that is expected within the alias set of an answer from the first
    flights; the last draw where none of MOST_DRAWS is one."""
    for k in range(MOST_DRAWS):
        engine = load_engine(path)
        drawn = draw(engine, seed, trial + k * FURTHER_DRAWS, (truth,), (kinds.SINGLE,))
        sealed = replace(
            drawn,
            trial=trial,
            kind=kinds.PLANNED,
            flights=[
                {c: v[int(RECORDED[0] * len(v)) : int(RECORDED[1] * len(v))] for c, v in f.items()}
                for f in drawn.flights[: drawn.training]
            ],
        )
        if _is_ambiguous(engine, sealed):
            break
    return sealed


def _is_ambiguous(engine: Engine, sealed: Sealed) -> bool:
    clean = evidence_of(engine, sealed, record(engine, sealed), clean=True)
    far = separability(clean, sealed.causes, dict(sealed.health), sealed.without, sealed.values)
    return bool(far.ok and far.total >= VISIBLE and far.nearest < ALIAS)
