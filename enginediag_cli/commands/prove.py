"""`enginediag prove`: blind trials of the whole chain, with the score sheet."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

import click

from enginediag_cli.commands.options import (
    ConfigFile,
    OutputFile,
    exit_codes,
    message_options,
    output_options,
    pass_messages,
    seed_option,
)
from enginediag_cli.presentation.messages import Messages
from enginediag_cli.presentation.output import Output
from enginediag_cli.trials.blind.kinds import KINDS, TRUTHS

if TYPE_CHECKING:
    from enginediag_cli.trials.blind.journal import Record
    from enginediag_cli.trials.blind.trial import Plan
    from enginediag_cli.trials.journal import Journal


@click.command(short_help="Prove on blind trials what the search for missing physics finds.", epilog=exit_codes())
@click.argument("engine", metavar="[ENGINE.yaml]", type=ConfigFile(), required=False)
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
    type=click.Choice((*TRUTHS, "both")),
    default="both",
    show_default=True,
    help="same_model: the truth differs from the model in what is concealed alone; map_error: its maps, "
    "cooling and gas differ a little as well, and the explainer allows for 0.3 %.",
)
@click.option(
    "--kind",
    "chosen",
    multiple=True,
    type=click.Choice(KINDS),
    metavar="KIND",
    help=f"Only trials of this kind; may be given several times. One of {', '.join(KINDS)}.",
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
    trials: int,
    truth: str,
    chosen: tuple[str, ...],
    jobs: int | None,
    trials_output: str | None,
    resume: bool,
    sizes: bool,
    seed: int,
    output: Output,
) -> None:
    """Draw engines that lack, or do not lack, some physics; conceal it; and score what is said of their recordings.

    \b
    enginediag prove --trials 400 --seed 12 --format json -o sheet.json
    enginediag prove turbofan.yaml --trials 60 --kind null --kind single --truth same_model
    enginediag prove --trials 400 --seed 12 --trials-output trials.jsonl --resume

    The explainer is a process of its own that is given the recordings, the engine file, and what is known of noise and
    maps. ENGINE.yaml is turbofan.yaml when not given. The same seed gives the same sheet, whatever --jobs.
    """
    from enginediag_cli.shipped import shipped
    from enginediag_cli.trials.blind.journal import plan_key, trials_journal
    from enginediag_cli.trials.blind.trial import Plan

    if resume and not trials_output:
        raise click.UsageError("--resume goes on from --trials-output FILE, which was not given")
    path = engine or str(shipped("turbofan.yaml"))
    plan = Plan(path, seed, TRUTHS if truth == "both" else (truth,), chosen or KINDS)
    journal = trials_journal(Path(trials_output), plan_key(plan)) if trials_output else None
    records = _run(messages, plan, trials, jobs or os.cpu_count() or 1, journal, resume)
    _say(messages, records)
    _write(plan, records, sizes, output)


def _run(
    messages: Messages, plan: Plan, trials: int, jobs: int, journal: Journal[int, Record] | None, resume: bool
) -> list[Record]:
    from enginediag_cli.errors import DataError
    from enginediag_cli.trials.blind.check import check_engine
    from enginediag_cli.trials.blind.pool import run_trials
    from enginediag_cli.trials.pool import WorkerDiedError

    check_engine(plan.engine)
    finished: dict[int, Record] = {}
    if journal:
        finished = journal.read() if resume else {}
        if not finished:
            if not resume and journal.begun:
                raise DataError(f"{journal.path} holds trials already: go on with --resume, or remove it")
            journal.write({})
    todo = [k for k in range(trials) if k not in finished]
    if finished:
        messages.note(f"{trials - len(todo)} of {trials} trials are in {journal.path if journal else ''}")
    running = run_trials(plan, todo, jobs)
    try:
        for number, record in messages.progress(running, "prove", len(todo)):
            finished[number] = record
            if journal:
                journal.add(number, record)
    except (KeyboardInterrupt, WorkerDiedError):
        if journal:
            messages.note(
                f"{len(finished)} of {trials} trials are kept in {journal.path}; "
                "the same command with --resume goes on from there"
            )
        raise
    finally:
        running.close()
    if journal:
        journal.write(dict(sorted(finished.items())))
    return [finished[k] for k in range(trials)]


def _say(messages: Messages, records: list[Record]) -> None:
    """Facts about the run that are no part of the sheet."""
    seconds = sum(r["seconds"] for r in records) / len(records)
    explaining = sum(r["explainer_seconds"] for r in records) / len(records)
    messages.note(f"{len(records)} trials; CPU time of one: {explaining:.1f} s to explain, {seconds:.1f} s to score")
    unscored = sum(not r["scorer_converged"] for r in records)
    if unscored:
        messages.note(f"{unscored} trials could not be scored: a noise-free fit of the scorer did not converge")
    errors = [r for r in records if r["error"]]
    for r in errors:
        messages.warning(f"trial {r['trial']}: the explainer failed: {r['error']}")


def _write(plan: Plan, records: list[Record], sizes: bool, output: Output) -> None:

    from enginediag_cli.presentation.score_sheet_document import document
    from enginediag_cli.presentation.score_sheet_rows import LONG, bin_rows, rows, size_rows, table
    from enginediag_cli.recordings.provenance import header_lines

    found = document(plan, records, sizes)
    head = header_lines("prove", seed=plan.seed, configs=[plan.engine], notes={"trials": str(len(records))})
    scores = {name: found[name] for name in found["scores"]}
    if output.chosen_format() != "table" or output.columns:
        output.write_document(found, rows(scores, found["bins"]), LONG, provenance=head)
        return
    binned = ("lambda", "lambda_sep", "signal_to_noise")
    parts = [table(scores), *(bin_rows(found["bins"], what) for what in binned)]
    output.write_tables([*parts, *([size_rows(found["detectable_size"])] if sizes else [])])
