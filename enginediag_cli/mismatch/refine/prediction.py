"""What unseen flights say of a predicted change, whatever else is uncertain about them.

Whitened readings without the effect e and with it e − d, both in the covariance V = 1 + B Bᵀ of the model without it
(`unseen`), so that neither gains by doubting more. With w what B takes of e,

    e⊥ = V⁻¹e = e − B w      d⊥ = V⁻¹d      α = dᵀe⊥/dᵀd⊥      u_r = d⊥_r·(e⊥_r − α d⊥_r)

B holds what was identified, by its posterior, map errors among it, and the flights' own offsets, by their prior; for
the contrast of on and off a zero of every sensor in every flight as well, by a prior so wide that only changes count.
"""

from __future__ import annotations

import numpy as np

from enginediag_cli.mismatch.fit.identified import IdentifiedHypothesis
from enginediag_cli.mismatch.fit.projection import Frame
from enginediag_cli.mismatch.fit.stretches import by_stretches
from enginediag_cli.mismatch.refine.criteria import Prediction, Records

FREE = 1e3
"""Prior standard deviation of an instrument's zero that is left free, in those of its noise."""


class Change:
    """Scores and information of the records for the share of a predicted change; parts of readings add up."""

    def __init__(self, count: int):
        self.pull = np.zeros(count)  # dᵀe⊥ (N,)
        self.length = np.zeros(count)  # dᵀd⊥ (N,)
        self.cross = np.zeros(count)  # d⊥·e⊥ (N,)
        self.own = np.zeros(count)  # d⊥·d⊥ (N,)
        self.misfit, self.readings = 0.0, 0  # eᵀe⊥
        self.recording = np.zeros(count, int)

    def add(
        self,
        pair: tuple[IdentifiedHypothesis, IdentifiedHypothesis],
        parts: tuple[np.ndarray, np.ndarray],
        of: Records,
        on: np.ndarray | None = None,
    ) -> None:
        """Readings of unseen flights as predicted without and with the effect, and e and B of the former; `on` (N,):
        where the effect is on."""
        frame = Frame(pair[0])
        e, B = parts
        e1 = frame.rows(pair[1].fit.equations.residual[:, :, None])[:, 0]
        record = frame.record
        if of is Records.CONTRAST:
            B = np.concatenate([B, _zeros(pair[0], frame)], axis=1)
        if of is Records.ON and on is not None:
            keep = on[record]
            e, e1, B, record = e[keep], e1[keep], B[keep], record[keep]
        d = e - e1
        whole = np.column_stack([e, d])
        left = whole - B @ np.linalg.solve(np.eye(B.shape[1]) + B.T @ B, B.T @ whole)
        for sums, values in (
            (self.pull, d * left[:, 0]),
            (self.length, d * left[:, 1]),
            (self.cross, left[:, 0] * left[:, 1]),
            (self.own, left[:, 1] ** 2),
        ):
            np.add.at(sums, record, values)
        self.misfit += float(e @ left[:, 0])
        self.readings += len(e)
        self.recording = pair[0].problem.recording

    def judged(self, of: Records) -> Prediction:
        """By all that was added."""
        S = float(self.length.sum())
        told = self.own > 0.0
        if not S > 0.0:
            return Prediction(of, np.nan, 0.0, 1.0, np.inf, 0.0, 0, 0)
        share = float(self.pull.sum()) / S
        scores = (self.cross - share * self.own)[told]
        found = by_stretches(scores[:, None], self.own[told][:, None, None], np.array([[S]]), self.recording[told])
        error, dispersion = float(np.sqrt(found.covariance[0, 0])), (self.misfit - share**2 * S) / self.readings
        return Prediction(of, share, S, dispersion, error, found.effective, found.length, int(told.sum()))


def _zeros(there: IdentifiedHypothesis, frame: Frame) -> np.ndarray:
    """Whitened rows (n, R m) of a free zero of every sensor in every recording."""
    recording, m = there.problem.recording, len(there.problem.sensors)
    count = int(recording.max()) + 1
    columns = np.zeros((len(recording), m, count * m))
    for r in range(count):
        for s in range(m):
            columns[recording == r, s, r * m + s] = FREE * frame.sigma[s]
    return frame.rows(columns)
