"""Sums of columns (a gauge pressure and the ambient one), and the consensus of redundant probes."""

from __future__ import annotations

import numpy as np

from enginediag_cli.config.fields import Field, Section
from enginediag_cli.recordings.derived.rule import Columns, Rule, Settings


def consensus(readings: np.ndarray, agree_within: float, least: int = 1, *, median: bool = False) -> np.ndarray:
    """(N,) mean or median of the probes (P, N) of the largest group that agrees: all within `agree_within` of one of
    them. NaN where fewer than `least` agree, and where two groups that share no probe are as large: nobody knows which
    of two is wrong."""
    known = np.isfinite(readings)
    with np.errstate(invalid="ignore"):
        near = np.abs(readings[:, None, :] - readings[None, :, :]) <= agree_within  # (P, P, N), false where missing
    size = near.sum(axis=1)
    best = np.argmax(size, axis=0)
    most = np.max(size, axis=0, initial=0)
    group = np.take_along_axis(near, best[None, None, :], axis=0)[0]
    apart = ~np.einsum("pqn,qn->pn", near, group).astype(bool) & known  # probes with no neighbour in the group
    tied = ((size == most) & apart).any(axis=0)
    taken = np.where(group, readings, np.nan)
    good = (most >= max(least, 1)) & ~tied
    result = np.full(readings.shape[1], np.nan)
    if good.any():
        result[good] = (np.nanmedian if median else np.nanmean)(taken[:, good], axis=0)
    return result


def _sum(columns: Columns, settings: Settings) -> np.ndarray:
    total = np.sum([columns[name] for name in settings["of"]], axis=0)
    for name in settings["minus"]:
        total = total - columns[name]
    return np.asarray(total, dtype=float)


def _consensus(columns: Columns, settings: Settings) -> np.ndarray:
    readings = np.array([columns[name] for name in settings["of"]])
    return consensus(readings, settings["agree_within"], settings["least"], median=settings["take"] == "median")


SUM = Rule(
    Section(
        "sum",
        "sum of columns in one unit, as a gauge pressure and the ambient pressure",
        (
            Field("of", "texts", "columns to add"),
            Field("minus", "texts", "columns to subtract", ()),
        ),
    ),
    lambda settings: [*settings["of"], *settings["minus"]],
    _sum,
    one_unit=True,
)

CONSENSUS = Rule(
    Section(
        "consensus",
        "mean of those redundant probes that agree; missing where no group of them is the largest",
        (
            Field("of", "texts", "columns of the probes, in one unit"),
            Field("agree_within", "number", "largest difference of probes that agree, in that unit", minimum=0.0),
            Field("least", "integer", "fewest probes that must agree; others missing, one may do", 1, minimum=1),
            Field("take", "choice", "what is taken of those that agree", "mean", choices=("mean", "median")),
        ),
    ),
    lambda settings: list(settings["of"]),
    _consensus,
    one_unit=True,
)
