"""`enginediag simulate`: fly an engine, healthy or faulty, and write what its sensors record."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator
from contextlib import ExitStack
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

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
from enginediag_cli.commands.parameter_types import CSV_SUFFIXES
from enginediag_cli.presentation.messages import Messages
from enginediag_cli.presentation.output import Output
from enginediag_cli.presentation.summaries import SIMULATE
from enginediag_cli.progress import each

if TYPE_CHECKING:
    from enginediag_cli.engine.model import EngineLike
    from enginediag_cli.simulation.conditions import Conditions
    from enginediag_cli.simulation.noise import ColumnNoise
    from enginediag_cli.simulation.simulate import Simulated

NOISE_KINDS = ("none", "gaussian", "uniform", "correlated", "quantised")
REASONS_SHOWN = 5
"""Reasons that are told one by one; there are rarely more kinds, the rest are counted."""

LOOSE = "the run of these could not be made exact: energy balances to about 1e-6 there"
"""Of records of moving engines."""

CONFIG_FILE = ConfigFile()


@click.command(short_help="Simulate the recording of an engine.", epilog=exit_codes())
@click.argument("engine_file", metavar="ENGINE", type=CONFIG_FILE)
@click.option(
    "--flight",
    metavar="FILE",
    type=CONFIG_FILE,
    help="Flights to fly; without it and --conditions, a few flights of an airliner.",
)
@click.option(
    "--conditions",
    metavar="FILE",
    type=click.Path(exists=True, dir_okay=False, allow_dash=True),
    help="Operating conditions record by record, instead of flights; - is standard input.",
)
@click.option(
    "--fault",
    "faults",
    metavar="FILE",
    type=CONFIG_FILE,
    multiple=True,
    help="Faults to put in; may be given several times.",
)
@click.option(
    "--noise",
    type=click.Choice(NOISE_KINDS),
    default=None,
    help="Sensor noise: none, gaussian (sizes of the engine file; default), uniform (1 % of the "
    "maximum reading wide), correlated (gaussian, 0.8 from record to record), quantised (rounding "
    "only).",
)
@click.option("--flights", metavar="N", type=click.IntRange(min=1), help="Number of flights, or of days on the ground.")
@click.option("--records", metavar="N", type=click.IntRange(min=1), help="End after N records.")
@click.option(
    "--truth",
    metavar="FILE",
    type=OutputFile(CSV_SUFFIXES),
    help="Write what is really wrong, record by record, to FILE.",
)
@click.option(
    "--steady",
    is_flag=True,
    help="Take every record as steady, also of an engine with states (inertias and the like).",
)
@seed_option
@output_options
@message_options
@pass_messages
def simulate(
    messages: Messages,
    engine_file: str,
    flight: str | None,
    conditions: str | None,
    faults: tuple[str, ...],
    noise: str | None,
    flights: int | None,
    records: int | None,
    truth: str | None,
    steady: bool,
    seed: int,
    output: Output,
) -> None:
    """Simulate what the sensors of ENGINE record.

    \b
    enginediag simulate configs/turbofan.yaml --flights 3 --seed 1 -o healthy.csv
    enginediag simulate configs/turbofan.yaml --fault configs/faults/hpc_fouling.yaml --truth true.csv | head
    enginediag simulate configs/turbofan.yaml --flight configs/flights/sweep.yaml --records 1000 --noise none

    An engine whose file gives states (inertia_kg_m2 of a shaft, terms that remember) is flown along time.
    Points that the engine cannot reach keep their row, with empty readings and the reason in `status`. The
    same seed gives the same flights and the same noise, with faults or without. The header names the fault
    files; leave it out with --no-header where the diagnosis is to be blind.
    """
    import numpy as np

    from enginediag_cli.faults.fault_file import load_faults
    from enginediag_cli.physics.engine_file import load_engine
    from enginediag_cli.recordings.provenance import header_lines
    from enginediag_cli.simulation.moving import moves, told_states
    from enginediag_cli.simulation.simulate import simulate_in_chunks

    _check_usage(flight, conditions, flights, truth, output)
    engine = load_engine(Path(engine_file))
    wrong = load_faults(*faults)
    flying, noisy = (np.random.default_rng([seed, stream]) for stream in (0, 1))
    given, noise_of_columns, inherited = _flown(engine, flight, conditions, flights, records, noise, flying)
    _warn_outside(messages, engine, given)
    pieces = simulate_in_chunks(engine, given, wrong, noise_of_columns, noisy, steady=steady)
    moving = not steady and moves(engine, given)
    asked = {"noise": noise, "flights": flights, "records": records, "states": told_states(engine) if moving else None}
    notes = {"engine": engine.name, **{key: str(value) for key, value in asked.items() if value is not None}}
    head = header_lines(
        "simulate",
        seed=seed,
        configs=[engine_file, *([flight] if flight else []), *faults],
        notes=notes,
        inherited=inherited,
    )
    reasons = _write(pieces, output, truth, head)
    _report(messages, reasons, len(given))
    if moving:
        messages.note(f"integrated along time with the states {told_states(engine)}; --steady takes records as steady")


def _check_usage(
    flight: str | None,
    conditions: str | None,
    flights: int | None,
    truth: str | None,
    output: Output,
) -> None:
    if flight and conditions:
        raise click.UsageError("--flight and --conditions exclude each other")
    if flights and conditions:
        raise click.UsageError("--flights counts generated flights; --conditions brings its own")
    if truth == "-":
        raise click.UsageError("--truth needs a file of its own")


def _flown(
    engine: EngineLike,
    flight: str | None,
    conditions: str | None,
    flights: int | None,
    records: int | None,
    noise: str | None,
    rng: Any,
) -> tuple[Conditions, dict[str, ColumnNoise], tuple[str, ...]]:
    """(operating conditions, noise of each column, provenance of the conditions)."""
    from enginediag_cli.config.kinds import load_checked
    from enginediag_cli.errors import Mark
    from enginediag_cli.recordings.read import read_all
    from enginediag_cli.simulation.default_flight import default_plan
    from enginediag_cli.simulation.flights import generate_flights
    from enginediag_cli.simulation.noise import KINDS, column_noise
    from enginediag_cli.simulation.tables import conditions_of

    mark = Mark("--noise")
    inherited: tuple[str, ...] = ()
    if conditions:
        recording = read_all(conditions, declared=(*engine.inputs, *engine.optional_inputs))
        inherited, given, spec = recording.provenance, conditions_of(recording), KINDS["gaussian"]
        given = given if records is None else given.slice(0, records)
    elif flight:
        checked = load_checked(flight, "flight")
        given = generate_flights(checked.values, engine, rng, flights=flights, records=records)
        spec = checked.values["noise"]
        mark = mark if noise else checked.mark(("noise",))
    else:
        plan = default_plan(engine)
        given = generate_flights(plan, engine, rng, flights=flights, records=records)
        spec = plan["noise"]
    return given, column_noise(KINDS[noise] if noise else spec, engine, mark), inherited


def _write(
    pieces: Iterator[Simulated],
    output: Output,
    truth: str | None,
    head: tuple[str, ...],
) -> Counter[str]:
    """Write recording and truth side by side; returns why points have no value, with counts."""
    from enginediag_cli.presentation.output import RECORDING_FORMATS
    from enginediag_cli.recordings.write import recording_output
    from enginediag_cli.simulation.tables import recording_of

    head = head if output.header else ()
    reasons: Counter[str] = Counter()
    first = next(pieces)  # an error in the first piece leaves no output behind
    with ExitStack() as files:
        hidden = files.enter_context(recording_output(truth, head)) if truth else None

        def told() -> Iterator[Simulated]:
            for piece in each(chain([first], pieces), "records simulated", size=_length):
                reasons.update(piece.reasons)
                if piece.loose:
                    reasons[LOOSE] += piece.loose
                if hidden is not None:
                    hidden.write(recording_of(piece.truth))
                yield piece

        if output.chosen_format() in RECORDING_FORMATS and not output.columns:
            writer = files.enter_context(output.open_recording(head))
            for piece in told():
                writer.write(recording_of(piece.columns))
        else:
            output.write_rows(_rows(told()), tuple(first.columns), summary=(*SIMULATE, *first.columns), provenance=head)
    return reasons


def _length(piece: Simulated) -> int:
    return len(next(iter(piece.columns.values())))


def _rows(pieces: Iterable[Simulated]) -> Iterator[dict[str, Any]]:
    for piece in pieces:
        names = tuple(piece.columns)
        for values in zip(*(column.tolist() for column in piece.columns.values()), strict=True):
            yield dict(zip(names, values, strict=True))


def _warn_outside(messages: Messages, engine: EngineLike, given: Conditions) -> None:
    from enginediag_cli.simulation.conditions import outside_envelope

    for column, count in outside_envelope(engine, given).items():
        low, high = engine.envelope[column]
        messages.warning(
            f"{count} of {len(given)} records have {column} outside the envelope of {engine.name}, {low:g} to {high:g}"
        )


def _report(messages: Messages, reasons: Counter[str], total: int) -> None:
    messages.note(f"{total} records simulated", counts={"records": total})
    for reason, count in reasons.most_common(REASONS_SHOWN):
        messages.warning(f"{count} of {total} records: {reason}")
    rest = reasons.most_common()[REASONS_SHOWN:]
    if rest:
        messages.warning(f"{sum(count for _, count in rest)} of {total} records: {len(rest)} other reasons")
