"""`enginediag prove`: blind trials of the whole chain, with the score sheet."""

from __future__ import annotations

import os
from functools import partial
from typing import TYPE_CHECKING

import click

from enginediag_cli.cli.options import (
    ConfigFile,
    OutputFile,
    exit_codes,
    message_options,
    output_options,
    pass_messages,
    seed_option,
)
from enginediag_cli.cli.proving import (
    BOTH,
    EXPLAIN,
    ISOLATE,
    Asked,
    Kept,
    finished_trials,
    prove_isolation,
    tell_cost,
)
from enginediag_cli.report.messages import Messages
from enginediag_cli.report.output import Output
from enginediag_cli.validation.kinds import APART, CHOICES, FIELD, ISOLATION_CHOICES, ISOLATION_KINDS, KINDS, TRUTHS

if TYPE_CHECKING:
    from enginediag_cli.validation.explain_trials import Plan, Record


@click.command(
    short_help="Prove on blind trials what is found, and whether it is right as often as it says.", epilog=exit_codes()
)
@click.argument("engine", metavar="[ENGINE.yaml]", type=ConfigFile(), required=False)
@click.option(
    "--question",
    type=click.Choice([EXPLAIN, ISOLATE]),
    default=EXPLAIN,
    show_default=True,
    help="explain: is physics missing, and which; isolate: what changed in a flight since the healthy ones.",
)
@click.option(
    "--trials",
    metavar="N",
    type=click.IntRange(min=1),
    default=400,
    show_default=True,
    help="How many engines to draw, conceal something in, and ask about.",
)
@click.option(
    "--truth",
    type=click.Choice((*TRUTHS, BOTH)),
    help="same_model: the truth differs from the model in what is concealed alone; map_error: its maps, "
    "cooling and gas differ a little as well, and the explainer allows for 0.3 %; realistic: tables for maps, "
    "instruments, clocks, probes and noise as they are, airline sensors in a third of the trials. Default: both of the "
    "first two to explain, realistic to isolate.",
)
@click.option(
    "--kind",
    "chosen",
    multiple=True,
    type=click.Choice(tuple(dict.fromkeys((*CHOICES, *ISOLATION_CHOICES)))),
    metavar="KIND",
    help=f"Only trials of this kind; may be given several times. To explain, one of {', '.join(KINDS)}, or, "
    "never drawn unasked, dynamic: recordings that move and effects that remember; law: effects that no library holds; "
    "planned: effects with rivals, what to fly next, and whether that tells; "
    f"several: two to four causes ({', '.join(k for own in APART.values() for k in own)}); to isolate, one of "
    f"{', '.join(ISOLATION_KINDS)}, or, never drawn unasked, {FIELD}: whole flights with everything at once, a "
    "quarter of them healthy.",
)
@click.option(
    "--jobs",
    metavar="J",
    type=click.IntRange(min=1),
    help="Trials at a time; one per core when not given. The result does not depend on it.",
)
@click.option(
    "--trials-output",
    metavar="FILE.jsonl",
    type=OutputFile(),
    help="Keep every trial, its sealed answer and its marks, one JSON line each.",
)
@click.option("--resume", is_flag=True, help="Go on from the trials that --trials-output holds.")
@click.option(
    "--sizes/--no-sizes",
    default=True,
    show_default=True,
    help="Also say how large every effect must be to be found, with and without the model-error floor.",
)
@seed_option
@output_options
@message_options
@pass_messages
def prove(
    messages: Messages,
    engine: str | None,
    question: str,
    trials: int,
    truth: str | None,
    chosen: tuple[str, ...],
    jobs: int | None,
    trials_output: str | None,
    resume: bool,
    sizes: bool,
    seed: int,
    output: Output,
) -> None:
    """Draw engines that lack, or do not lack, some physics, or that something changed in; conceal it; and score what is
    said of their recordings.

    \b
    enginediag prove --trials 400 --seed 12 --format json -o sheet.json
    enginediag prove turbofan.yaml --trials 60 --kind null --kind single --truth same_model
    enginediag prove --trials 400 --seed 12 --trials-output trials.jsonl --resume
    enginediag prove --kind law --trials 200 --seed 12
    enginediag prove --question isolate --truth realistic --trials 400 --seed 12
    enginediag prove --question isolate --kind field --trials 320 --seed 12

    The explainer, or isolator, is a process of its own that is given the recordings, the engine file, and what is known
    of noise and maps. ENGINE.yaml is turbofan.yaml when not given; of realistic truths other than those in the field
    each has one of turbofan, turbojet, power_plant and turboshaft. The same seed gives the same sheet, whatever --jobs.
    """
    if resume and not trials_output:
        raise click.UsageError("--resume goes on from --trials-output FILE, which was not given")
    asked = Asked(question, truth, chosen)
    asked.check()
    kept = Kept(trials, jobs or os.cpu_count() or 1, trials_output, resume)
    engines = asked.engines(engine)
    if question == ISOLATE:
        prove_isolation(messages, engines, seed, asked, kept).write(output)
        return
    from enginediag_cli.validation.causes import check_engine
    from enginediag_cli.validation.explain_trials import Plan, plan_key, run_trials

    plan = Plan(engines[0], seed, asked.truths, asked.kinds, engines=engines)
    for path in engines:
        check_engine(path)
    records = finished_trials(messages, plan_key(plan), partial(run_trials, plan), kept)
    _say(messages, records)
    _write(plan, records, sizes, output)


def _say(messages: Messages, records: list[Record]) -> None:
    """Facts about the run that are no part of the sheet."""
    tell_cost(messages, records, "explainer_seconds", "to explain")
    unscored = sum(not r["scorer_converged"] for r in records)
    if unscored:
        messages.note(f"{unscored} trials could not be scored: a noise-free fit of the scorer did not converge")
    errors = [r for r in records if r["error"]]
    for r in errors:
        messages.warning(f"trial {r['trial']}: the explainer failed: {r['error']}")


def _write(plan: Plan, records: list[Record], sizes: bool, output: Output) -> None:

    from enginediag_cli.api import header_lines
    from enginediag_cli.report.outputs.validation import PROVE
    from enginediag_cli.validation.rows import bin_rows, rows, score_sheet_document, size_rows, table

    found = score_sheet_document(plan, records, sizes)
    head = header_lines(
        "prove", seed=plan.seed, configs=[plan.engine], notes=PROVE.notes | {"trials": str(len(records))}
    )
    scores = {name: found[name] for name in found["scores"]}
    if output.chosen_format() != "table" or output.columns:
        output.write_document(found, rows(scores, found["bins"]), PROVE.names, provenance=head)
        return
    binned = ("lambda", "lambda_sep", "signal_to_noise")
    parts = [table(scores), *(bin_rows(found["bins"], what) for what in binned)]
    output.write_tables([*parts, *([size_rows(found["detectable_size"])] if sizes else [])])
