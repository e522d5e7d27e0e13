"""The score sheets of `prove`, as rows; the object of `--format json` holds the same by score."""

from __future__ import annotations

from enginediag_cli.presentation.outputs.declared import Table, column

_RATE = (
    column("rate", "number", "share, or mean, as the score says", empty=True),
    column("count", "integer", "how many of them", empty=True),
    column("of", "integer", "trials, or answers, that the rate is of"),
    column("low", "number", "lower end of its 95 % interval", empty=True),
    column("high", "number", "upper end of its 95 % interval", empty=True),
    column("target", "text", "what was asked; empty where nothing was", empty=True),
    column("met", "text", "yes or no; empty without a target", empty=True),
)

PROVE = Table(
    "prove",
    1,
    "one row per score, truth and kind of trials, then one per bin",
    (
        column("score", "text", "what is counted"),
        column("truth", "text", "same_model, map_error or realistic"),
        column("kind", "text", "kind of the trials; empty for the score's headline"),
        column("bin", "text", "bin of size or of stated probability; empty for all"),
        *_RATE,
    ),
)

ISOLATED = Table(
    "prove/isolate",
    1,
    "prove --question isolate: the sheet, reliability of stated probabilities, and outcomes by kind",
    (
        column("table", "text", "sheet, reliability, outcomes or kinds"),
        column("score", "text", "what is counted"),
        column("kind", "text", "kind of the trials", empty=True),
        column("bin", "text", "bin of stated probability", empty=True),
        column("stated", "number", "mean stated probability of the bin", empty=True),
        *_RATE,
    ),
)
