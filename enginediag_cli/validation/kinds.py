"""Kinds of trials and of truths, and how often each is drawn."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

SAME_MODEL, MAP_ERROR, REALISTIC = "same_model", "map_error", "realistic"
TRUTHS = (SAME_MODEL, MAP_ERROR, REALISTIC)

USUAL = (SAME_MODEL, MAP_ERROR)
"""Truths that are drawn when nobody chooses, and that are on every sheet."""

NULL, SINGLE, PAIR, WITHHELD = "null", "single", "pair", "withheld"
HIDDEN_SWITCH, FAULT, EFFECT_AND_FAULT = "hidden_switch", "fault", "effect_and_fault"

INPUT_NOISE, CORRELATED_NOISE, UNKNOWN_NOISE = "input_noise", "correlated_noise", "unknown_noise"
VARIANTS = (INPUT_NOISE, CORRELATED_NOISE, UNKNOWN_NOISE)
"""Of null and single trials: inputs recorded with noise; correlated noise of known correlation; noise of
unknown size."""

WEIGHTS: Mapping[str, int] = {
    NULL: 14,
    SINGLE: 26,
    PAIR: 11,
    WITHHELD: 11,
    HIDDEN_SWITCH: 8,
    FAULT: 6,
    EFFECT_AND_FAULT: 6,
    **{f"{kind}_{variant}": 3 for kind in (NULL, SINGLE) for variant in VARIANTS},
}
KINDS = tuple(WEIGHTS)
"""Trials by kind, with their shares when nobody chooses."""

DYNAMIC = "dynamic"
"""Of null, single and pair trials: moving recordings, and dynamic effects. All of them, as one choice."""
DYNAMIC_WEIGHTS: Mapping[str, int] = {f"{NULL}_{DYNAMIC}": 20, f"{SINGLE}_{DYNAMIC}": 60, f"{PAIR}_{DYNAMIC}": 20}
"""Their shares: mostly trials in which an effect is to be named."""
DYNAMIC_KINDS = tuple(DYNAMIC_WEIGHTS)
"""Trials that are drawn only on request."""

LAW = "law"
"""Of null and single trials: an effect that is not in the library, given by a formula. Both, as one choice."""
LAW_WEIGHTS: Mapping[str, int] = {f"{NULL}_{LAW}": 20, f"{SINGLE}_{LAW}": 80}
"""Their shares: mostly trials in which a formula is to be found."""
LAW_KINDS = tuple(LAW_WEIGHTS)

SEVERAL = "several"
"""Two to four causes of mixed kinds. All numbers of them, as one choice."""
SEVERAL_WEIGHTS: Mapping[str, int] = {f"two_{SEVERAL}": 45, f"three_{SEVERAL}": 35, f"four_{SEVERAL}": 20}
"""Their shares: engines have two things wrong more often than four."""
SEVERAL_KINDS = tuple(SEVERAL_WEIGHTS)
COUNTS: Mapping[str, int] = dict(zip(SEVERAL_KINDS, (2, 3, 4), strict=True))
"""Of causes."""

HISTORY = "history"
"""Engines followed over flights. A choice of its own, and a task of the diagnosing process."""

PLANNED = "planned"
"""An effect with alternatives, the next flight, and whether it resolves them."""

SPECIAL_KINDS: Mapping[str, Mapping[str, int]] = {
    DYNAMIC: DYNAMIC_WEIGHTS,
    LAW: LAW_WEIGHTS,
    SEVERAL: SEVERAL_WEIGHTS,
    PLANNED: {PLANNED: 1},
}
"""Choice → its kinds of trials with their shares: drawn only on request."""
CHOICES = (*KINDS, *(c for special_choice, own in SPECIAL_KINDS.items() for c in (special_choice, *own)))
"""What may be chosen."""

MODEL_ERROR: Mapping[str, float | None] = {SAME_MODEL: 0.0, MAP_ERROR: 0.003, REALISTIC: None}
"""Accuracy of the maps that the diagnosing process is given; None: that of the engine file, which the truth does not
keep."""


def base_kind(kind: str) -> str:
    """The kind without its variant: null_input_noise is null."""
    for variant in (*VARIANTS, *SPECIAL_KINDS):
        kind = kind.removesuffix(f"_{variant}")
    return kind


def noise_variant(kind: str) -> str:
    """The variant of noise; "" where there is none."""
    return next((v for v in VARIANTS if kind.endswith(v)), "")


def is_dynamic(kind: str) -> bool:
    """Whether the recordings of this kind of trial move."""
    return kind in DYNAMIC_KINDS


def special_choice(kind: str) -> str:
    """The choice that a kind of trial is drawn for; "" for one that is drawn by default."""
    return next((c for c, own in SPECIAL_KINDS.items() if kind in own), "")


def kinds_on_sheet(kind: str) -> tuple[str, ...]:
    """All kinds of trials on one sheet with this one."""
    return tuple(SPECIAL_KINDS[special_choice(kind)]) if special_choice(kind) else KINDS


def expand_choices(chosen: Sequence[str]) -> tuple[str, ...]:
    """The kinds of trials that choices stand for."""
    return tuple(dict.fromkeys(k for c in chosen for k in SPECIAL_KINDS.get(c, (c,))))


def weight(kind: str) -> int:
    """Its share among those that are chosen."""
    return SPECIAL_KINDS[special_choice(kind)][kind] if special_choice(kind) else WEIGHTS[kind]


COMPONENT, OUTPUT_SENSOR, INPUT_CHANNEL, PHYSICS = "component", "output_sensor", "input_channel", "physics"

ISOLATION_WEIGHTS: Mapping[str, int] = {
    NULL: 20,
    COMPONENT: 30,
    OUTPUT_SENSOR: 14,
    INPUT_CHANNEL: 10,
    SEVERAL: 16,
    PHYSICS: 10,
}
"""Shares of kinds of trials when nobody chooses: mostly what engines have, and enough nulls to count false names."""
ISOLATION_KINDS = tuple(ISOLATION_WEIGHTS)
INSTRUMENTS = (OUTPUT_SENSOR, INPUT_CHANNEL)
"""Kinds of which what is wrong is an instrument alone."""

ISOLATION_TRUTHS = (SAME_MODEL, REALISTIC)

FIELD = "field"
"""Whole flights of an airliner a minute apart, judged with everything at once that a truth has; drawn only on request.
What each trial conceals is set by its number, so that shares are the same on every seed."""
FIELD_SHARES: Mapping[str, int] = {NULL: 8, COMPONENT: 11, OUTPUT_SENSOR: 4, INPUT_CHANNEL: 2, SEVERAL: 7}
"""Trials of each kind in a round of 32: a quarter healthy, and of 320 trials 80 healthy and 240 with a fault."""
FIELD_JUDGED = 8
"""Flights in a row that are judged of one engine, each with its own fault or none: an engine is identified once."""
_ROUND = tuple(kind for kind, share in FIELD_SHARES.items() for _ in range(share))
_STRIDE = 13
"""Coprime to the round's length: neighbours in a round differ in kind, so that the first few trials hold all."""


def field_kind(trial: int) -> str:
    """What trial number `trial` of a campaign in the field conceals."""
    return _ROUND[trial * _STRIDE % len(_ROUND)]


ISOLATION_CHOICES = (*ISOLATION_KINDS, FIELD)
"""What may be chosen."""
