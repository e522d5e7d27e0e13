"""Fits side by side: what of a trial one process hands to another.

An engine that carries effects is full of hooks that no process can hand over, and need not: model and problem follow
from evidence, nuisance and hypothesis. What was found does not: the fit, the whitened rows, and where the model's
solutions lie, from which the next ones begin.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

from enginediag_cli.identification.gauss_newton import Fit
from enginediag_cli.mismatch.fit.evidence import Dataset
from enginediag_cli.mismatch.fit.identified import IdentifiedHypothesis, Nuisance, problem_with
from enginediag_cli.mismatch.fit.options import Option, combine_options
from enginediag_cli.mismatch.fit.projection import Projection
from enginediag_cli.mismatch.fit.trial import HypothesisFit
from enginediag_cli.parallel import ProcessCodec


@dataclass(frozen=True)
class Handed:
    """A trial without its model and problem; `memory`: of the model, `projected`: of the projection."""

    options: tuple[Option, ...]
    fit: Fit
    settled: bool
    memory: Any
    projected: Mapping[str, Any]


def trials_handed(evidence: Dataset, along: Nuisance, options: Sequence[Option]) -> ProcessCodec:
    """How trials of these options come, that begin at no other fit."""

    def pack(trial: HypothesisFit) -> Handed:
        found = trial.found
        return Handed(trial.options, found.fit, found.settled, found.model.memory, trial.projection.kept)

    def unpack(of: Handed) -> HypothesisFit:
        hypothesis = combine_options(*of.options)
        model, problem, rho = problem_with(evidence, hypothesis, along)
        model.restore_memory(of.memory)
        found = IdentifiedHypothesis(evidence, hypothesis, model, problem, of.fit, of.settled, rho)
        return HypothesisFit(of.options, found, Projection.again(found, of.projected))

    parts = [getattr(e, f.name) for o in options for e in o.hypothesis.effects for f in fields(e)]
    return ProcessCodec(pack, unpack, [*options, *parts])
