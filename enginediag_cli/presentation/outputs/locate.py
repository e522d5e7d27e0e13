"""Rows of `locate`: places of the map, or places with an amplitude of their own in every record."""

from __future__ import annotations

from enginediag_cli.presentation.outputs.declared import Table, column

LOCATE = Table(
    "locate",
    1,
    "one row per place within reach of the best; a single one where there is no place to tell",
    (
        column("verdict", "text", "what kind of mismatch it is, or that there is none"),
        column("rank", "integer", "rank of the place, from 1", empty=True),
        column("driver", "text", "what it varies with; what these flights cannot tell apart as a = b", empty=True),
        column("along", "text", "the driver of the group that was scored", empty=True),
        column("location", "text", "where it acts", empty=True),
        column("component", "text", "component of the place", empty=True),
        column("within", "boolean", "whether the place is within reach of the best", empty=True),
        column("statistic", "number", "fall of χ² by a free-form correction there", empty=True),
        column("dof", "number", "degrees of freedom of the correction", empty=True),
        column("p_value", "number", "adjusted for all places looked at", empty=True),
        column("share", "number", "share of the excess χ² that it takes away", empty=True),
        column("stability", "number", "share of resamples of whole flights in which it comes first", empty=True),
        column("driver_stability", "number", "share of resamples in which its driver comes first", empty=True),
        column("refit", "number", "fall of χ² after a refit inside the model", empty=True),
    ),
)

PER_RECORD = Table(
    "locate/per-record",
    1,
    "locate --per-record: one row per place with a free amplitude in every record, best first",
    (
        column("rank", "integer", "rank of the place, from 1"),
        column("location", "text", "where the amplitude acts; nothing for the model as it is"),
        column("component", "text", "component of the place", empty=True),
        column("chi2_per_record", "number", "χ² per record that is left"),
        column("times_best", "number", "that over the χ² per record of the best"),
        column("at_bound", "integer", "identified parameters that end at a bound"),
        column("failed", "integer", "records that could not be computed"),
        column("converged", "boolean", "whether the fit converged"),
    ),
)
