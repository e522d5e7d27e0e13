"""`enginediag study`: how often diagnosis is right, over many engines with known faults."""

from __future__ import annotations

import os
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import click

from enginediag_cli.cli.options import (
    ConfigFile,
    OutputFile,
    exit_codes,
    message_options,
    output_options,
    pass_messages,
)
from enginediag_cli.report.messages import Messages
from enginediag_cli.report.output import Output
from enginediag_cli.report.summaries import STUDY

if TYPE_CHECKING:
    from enginediag_cli.validation.rows import Results
    from enginediag_cli.validation.studies import Study
    from enginediag_cli.validation.study_runs import Batch, Tallies
    from enginediag_cli.validation.trials import Journal

SHOW = ("rates", "counts", "reliability")


@click.command(short_help="Run a Monte-Carlo study of diagnosis.", epilog=exit_codes())
@click.argument("file", metavar="FILE", type=ConfigFile())
@click.option(
    "--show",
    type=click.Choice(SHOW),
    default="rates",
    show_default=True,
    help="What a table or CSV shows: rates with binomial intervals; counts per parameter, as in the paper; "
    "reliability of stated probabilities. JSON holds all of it.",
)
@click.option(
    "--repetitions",
    metavar="N",
    type=click.IntRange(min=1),
    help="Diagnoses of every case, instead of those of the file.",
)
@click.option("--seed", metavar="N", type=click.IntRange(min=0), help="Seed, instead of that of the file.")
@click.option(
    "--processes",
    metavar="N",
    type=click.IntRange(min=1),
    help="Processes to work with; one per core when not given. The result does not depend on it.",
)
@click.option(
    "--journal",
    metavar="FILE",
    type=OutputFile(),
    help="Keep finished batches in FILE, and go on from what it holds. With "
    "-o, it lies beside the output while the study runs.",
)
@output_options
@message_options
@pass_messages
def study(
    messages: Messages,
    file: str,
    show: str,
    repetitions: int | None,
    seed: int | None,
    processes: int | None,
    journal: str | None,
    output: Output,
) -> None:
    """Run the study that FILE describes: a row per case and method.

    \b
    enginediag study configs/studies/paper.yaml -o paper.json
    enginediag study configs/studies/paper.yaml --repetitions 50 --show counts
    enginediag study configs/studies/calibration.yaml --show reliability

    Data come from the full nonlinear engine. The same seed gives the same counts, on any number of processes. A
    study that was interrupted goes on where it stopped when the same command is given again with -o or --journal.
    """
    from enginediag_cli.validation.studies import load_study
    from enginediag_cli.validation.study_runs import study_journal, study_key

    described = load_study(file)
    seed = described.seed if seed is None else seed
    kept = Path(journal) if journal else None if output.to_stdout else Path(output.path + ".journal")
    notes = study_journal(kept, study_key(described, seed, repetitions)) if kept else None
    results = _run(messages, described, seed, repetitions, processes or os.cpu_count() or 1, notes)
    _write(described, results, seed, show, output, file)
    if notes and not journal:
        notes.path.unlink(missing_ok=True)


def _run(
    messages: Messages,
    described: Study,
    seed: int,
    repetitions: int | None,
    processes: int,
    notes: Journal[Batch, Tallies] | None,
) -> Results:
    from enginediag_cli.validation.rows import totals
    from enginediag_cli.validation.study_runs import batches, run_batch
    from enginediag_cli.worker_pool import WorkerDiedError, run_pieces

    every = batches(described, repetitions)
    finished = notes.read() if notes else {}
    todo = [batch for batch in every if batch not in finished]
    if finished:
        messages.note(f"{len(every) - len(todo)} of {len(every)} batches are in {notes.path if notes else ''}")
    running = run_pieces(partial(run_batch, described.path, seed), todo, processes)
    try:
        for batch, tallies in messages.progress(running, described.path.stem, len(todo)):
            finished[batch] = tallies
            if notes:
                notes.add(batch, tallies)
    except (KeyboardInterrupt, WorkerDiedError):
        if notes:
            messages.note(
                f"{len(finished)} of {len(every)} batches are kept in {notes.path}; the same command goes on from there"
            )
        raise
    finally:
        running.close()
    return totals(described, finished)


def _write(described: Study, results: Results, seed: int, show: str, output: Output, file: str) -> None:
    from enginediag_cli.api import header_lines
    from enginediag_cli.report.outputs.validation import COUNTS, RELIABILITY
    from enginediag_cli.report.outputs.validation import STUDY as STUDY_ROWS
    from enginediag_cli.validation.rows import as_json, shortened, study_rows

    found, columns = study_rows(described, results, show)
    declared = {"rates": STUDY_ROWS, "counts": COUNTS, "reliability": RELIABILITY}[show]
    head = header_lines("study", seed=seed, configs=[file], notes=declared.notes)
    if output.chosen_format() == "table" and show == "rates" and not (output.wide or output.columns):
        found = [shortened(row) for row in found]
        columns = tuple(found[0])
    output.write_document(lambda: as_json(described, results, seed), found, columns, summary=STUDY, provenance=head)
