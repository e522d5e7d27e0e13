"""Derivatives of the readings by what may be missing, chunk by chunk, and as whitened rows."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

from enginediag_cli.engine.term import Effect
from enginediag_cli.identification import normal_equations
from enginediag_cli.mismatch.fit.extended import ExtendedModel
from enginediag_cli.mismatch.fit.identified import IdentifiedHypothesis
from enginediag_cli.mismatch.fit.projection import KEPT_BYTES, Projection, Rows, Whitening, derivatives


class Columns:
    """∂y/∂θ at a fit by name of the parameter, of the fit's model with effects that it does not carry."""

    def __init__(self, found: IdentifiedHypothesis, names: Iterable[str], effects: Iterable[Effect]):
        engine = found.evidence.engine
        carried = {e.label for e in (*engine.effects, *found.hypothesis.effects)}
        further = {e.label: e for e in effects if e.label not in carried}
        self.found = found
        self.at = {n: j for j, n in enumerate(dict.fromkeys(names))}
        self._model = ExtendedModel(
            engine.replace_effects((*engine.effects, *found.hypothesis.effects, *further.values())),
            found.model.discrepancies,
            like=found.model,
        )
        N, m = found.problem.measured.shape
        self._kept: list[np.ndarray] | None = [] if N * m * len(self.at) * 8 <= KEPT_BYTES else None

    def __getitem__(self, name: str) -> np.ndarray:
        """One parameter's (N, m)."""
        if self._kept is None:
            parts = [derivatives(self.found, [name], self._model, rows)[:, :, 0] for rows in self._spans()]
        else:
            parts = [J[:, :, self.at[name]] for _, J in self.chunks()]
        return np.concatenate(parts)

    def chunks(self) -> Iterator[tuple[slice, np.ndarray]]:
        """Records and their derivatives (n, m, L) by all the names, in order; not to be written into."""
        for k, rows in enumerate(self._spans()):
            if self._kept is not None and k < len(self._kept):
                yield rows, self._kept[k]
                continue
            J = derivatives(self.found, tuple(self.at), self._model, rows)
            if self._kept is not None:
                self._kept.append(J)
            yield rows, J

    def rest(self) -> None:
        """Hold no derivatives: what asks for them again has them computed again."""
        self._kept = None

    def _spans(self) -> Iterator[slice]:
        N, size = len(self.found.problem.recording), normal_equations.CHUNK_RECORDS
        return (slice(a, min(a + size, N)) for a in range(0, N, size))

    def whitened(self, projection: Projection) -> Iterator[tuple[Rows, np.ndarray, np.ndarray | None]]:
        """Rows of the nuisance with the columns beside them, in the two parts (n, m, L) of `Whitening.parts`."""
        whitening, chunks = Whitening(projection.frame), self.chunks()
        span, J = slice(0, 0), np.empty((0, 0, 0))
        for rows in projection.stream():
            if rows.span.start >= span.stop:
                span, J = next(chunks)
            own = J[rows.span.start - span.start : rows.span.stop - span.start]
            yield rows, *whitening.parts(own, rows.span)
