"""Where the records that are judged come from: a recorder file, one engine, its early life as reference, its end."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass
from functools import wraps
from typing import TYPE_CHECKING, Any

import click

from enginediag_cli.commands.options import ConfigFile, FiniteRange
from enginediag_cli.errors import DataError
from enginediag_cli.presentation.messages import Messages

if TYPE_CHECKING:
    from enginediag_cli.recordings.recorder import MappedRecording
    from enginediag_cli.recordings.table import Recording


@dataclass(frozen=True)
class Origin:
    """Choices of `origin_options`; reference and last are counts of records per flight and engine, 0 for none."""

    recorder: str | None = None
    engine_instance: str = ""
    reference: int = 0
    last: int = 0
    model_error: float = 0.0

    @property
    def configs(self) -> list[str]:
        """Files that the result depends on, for the provenance header."""
        return [self.recorder] if self.recorder else []

    @property
    def notes(self) -> dict[str, str]:
        """Choices that the result depends on, for the provenance header."""
        told = {
            "engine instance": self.engine_instance,
            "reference": self.reference and f"first {self.reference}",
            "judged": self.last and f"last {self.last}",
            "model_error": self.model_error,
        }
        return {name: str(value) for name, value in told.items() if value}

    def mapped(self, messages: Messages, file: str) -> Iterator[Recording]:
        """The file as its recorder maps it, whole; what was masked or left out goes to standard error."""
        assert self.recorder is not None
        wanted = self.engine_instance
        for m in read_mapped(messages, self.recorder, file, wanted):
            recording = m.recording
            if wanted and m.engine != wanted:
                recording = of_engine(recording, wanted)
                if not len(recording):
                    raise DataError(f"{file}: no record of engine {wanted!r}")
            yield recording


def of_engine(recording: Recording, wanted: str) -> Recording:
    """The records that name this engine in their column `engine`. Raises DataError when there is no such column."""
    import numpy as np

    if "engine" not in recording.text:
        raise DataError(f"{recording.source}: no column `engine`, in which records would name {wanted!r}")
    return recording.select(np.array(recording.text["engine"], dtype=str) == wanted)


def chosen_engine(names: Collection[str], wanted: str, file: str) -> str:
    """Which of the engines that a recorder tells apart is wanted; "" where it tells none apart. Raises DataError."""
    known = [name for name in names if name]
    if wanted in known or len(known) < 2:
        return wanted if wanted in known else (known[0] if known else "")
    what = f"no engine {wanted!r}" if wanted else "several engines"
    raise DataError(f"{file}: {what} in this recording; choose with --engine-instance one of {', '.join(known)}")


def read_mapped(messages: Messages, recorder: str, file: str, instance: str) -> list[MappedRecording]:
    """The engines of a foreign file, or the one wanted; what was masked or left out goes to standard error."""
    from enginediag_cli.recordings.recorder import load_recorder

    found = load_recorder(recorder).read(file)
    chosen = chosen_engine([m.engine for m in found], instance, file)
    found = [m for m in found if m.engine == chosen]
    for m in found:
        for line in m.report_lines():
            messages.note(line)
    return found


def origin_options(function: Callable[..., Any]) -> Callable[..., Any]:
    """`--recorder`, `--engine-instance`, `--reference`, `--last`, `--model-error` as one `origin: Origin`."""

    @wraps(function)
    def with_origin(
        *args: Any,
        recorder: str | None,
        engine_instance: str,
        reference: int,
        last: int,
        model_error: float,
        **others: Any,
    ) -> Any:
        return function(*args, origin=Origin(recorder, engine_instance, reference, last, model_error), **others)

    options = [
        click.option(
            "--recorder",
            metavar="FILE",
            type=ConfigFile(),
            help="Recorder of foreign recordings.",
        ),
        click.option("--engine-instance", default="", metavar="NAME", help="Use only this engine of the recordings."),
        click.option(
            "--reference",
            metavar="N",
            type=click.IntRange(min=0),
            default=0,
            help="Judge each flight and engine against its own first N records, believed healthy, instead "
            "of against the nominal engine alone.",
        ),
        click.option(
            "--last",
            metavar="N",
            type=click.IntRange(min=0),
            default=0,
            help="Judge only the last N records of each flight and engine.",
        ),
        click.option(
            "--model-error",
            metavar="SHARE",
            type=FiniteRange(0, 1),
            default=0.0,
            show_default=True,
            help="Relative error that the model makes about a change, for an engine with generic maps: "
            "0.2 allows each reading an error of 20 % of the rms relative deviation.",
        ),
    ]
    for option in reversed(options):
        with_origin = option(with_origin)
    return with_origin
