"""The score sheets of `prove`: as rows, and as one object, which holds the same by score."""

from __future__ import annotations

from enginediag_cli.presentation.outputs.declared import Table, column, part

_RATE = (
    column("rate", "number", "share, or mean, as the score says", empty=True),
    column("count", "integer", "how many of them", empty=True),
    column("of", "integer", "trials, or answers, that the rate is of"),
    column("low", "number", "lower end of its 95 % interval", empty=True),
    column("high", "number", "upper end of its 95 % interval", empty=True),
    column("target", "text", "what was asked; empty where nothing was", empty=True),
    column("met", "text", "yes or no; empty without a target", empty=True),
)

_RUN = (
    column("trials", "integer", "trials that were run"),
    column("failed_records", "integer", "records that could not be simulated"),
    column("seed", "integer", "seed of everything random"),
    column("truths", "texts", "truths that were asked for"),
    part("versions", "of the program and its libraries"),
)
_SCHEMA = column("schema", "text", "name and version of this schema")

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
    document=(
        _SCHEMA,
        column("scores", "texts", "names of the scores; each is a key of this object"),
        part("bins", "rates by truth and bin"),
        part("held_out_misfit", "χ² per reading of held-back flights, by truth"),
        part("trials_by_kind", "trials of each kind, by truth"),
        column("unscored", "integer", "trials that could not be scored"),
        column("kinds", "texts", "kinds of trials that were drawn"),
        part("model_error", "accuracy of the maps that the explainer allows for, by truth"),
        column("false_alarm", "number", "probability of a false finding that was asked for"),
        column("engine", "text", "engine file"),
        *_RUN,
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
        column("gap", "number", "rate less mean stated probability", empty=True),
        *_RATE,
    ),
    document=(
        _SCHEMA,
        part("sheet", "scores with their intervals and targets"),
        part("reliability", "bins of stated probability, by kind of name"),
        part("kinds", "outcomes by kind of trial"),
        part("engines", "outcomes by engine"),
        column("chosen_kinds", "texts", "kinds of trials that were drawn"),
        column("engine_files", "texts", "engine files"),
        *_RUN,
    ),
)
