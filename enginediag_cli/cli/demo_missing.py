"""`enginediag demo --missing-physics`: conceal an effect, find it, put it into the model, let unseen flights judge."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from enginediag_cli.cli.demo_steps import copy_shipped, head, run, tell
from enginediag_cli.errors import NoVerdictError
from enginediag_cli.report.messages import Messages

if TYPE_CHECKING:
    from enginediag_cli.validation.demonstration_missing import Found

COLUMNS = 110
"""Letters of a line of the story: what a terminal of usual width shows without breaking it."""


class Heard(Messages):
    """Messages that keep what a command says in sentences, for the demonstration to tell."""

    def __init__(self, debug: bool, color: str):
        super().__init__(debug=debug, color=color)
        self.said: list[str] = []

    def note(self, text: str, **fields: Any) -> None:
        self.said.append(text)


def play(messages: Messages, seed: int) -> None:
    """All steps, in the folder in which the program runs; NoVerdictError where one ends without its result."""
    from enginediag_cli.validation import demonstration_missing as script
    from enginediag_cli.validation import demonstration_missing as story

    copy_shipped(script.INGREDIENTS)
    head(1, "Conceal an effect: fly an engine that has it")
    script.prepare()
    for line in script.preparations():
        click.echo(f"   $ {line}")
    tell(story.concealed())
    run(messages, script.fly(script.RECORDED, script.FITTED_FLIGHTS, seed))
    run(messages, script.fly(script.UNSEEN, script.UNSEEN_FLIGHTS, seed + 1))
    head(2, "Where do model and recordings differ?")
    heard = Heard(debug=messages.debug, color=messages.color)
    run(heard, script.locate(), quiet=False)
    tell(_wrapped(heard.said))
    head(3, "What was left out of the model?")
    run(messages, script.explain())
    tell(_wrapped(story.read(script.EXPLAINED)["sentences"]))
    effects = script.named_effects(Path(script.EXPLAINED))
    if not effects:
        raise NoVerdictError("explain named no effect that a model could carry: there is nothing to refine")
    head(4, "Put it into the model, and let flights that were not used judge")
    run(messages, script.refine(effects))
    tell(_wrapped(story.read(script.REPORT)["sentences"]))
    head(5, "Does detect leave healthy flights alone?")
    for engine in (script.ENGINE, script.REFINED, script.TRUTH):
        run(messages, script.identify(engine))
        run(messages, script.detect(engine))
        tell([story.judged(story.read(script.detected_by(engine)), engine)])
    _close(story.read_found())


def _close(found: Found) -> None:
    from enginediag_cli.validation import demonstration_missing as script
    from enginediag_cli.validation import demonstration_missing as story

    click.echo("\nWhat was concealed, and what was found")
    tell(story.comparison(found))
    click.echo(f"\n{story.closing(found)}")
    click.echo(f"{script.REFINED} runs in every other command. Pictures: {script.MAP} and {script.BEFORE_AFTER}.")


def _wrapped(lines: Iterable[str]) -> Iterator[str]:
    """Sentences in lines of a terminal, the continuation indented by two more."""
    for line in lines:
        indent = line[: len(line) - len(line.lstrip())]
        yield from textwrap.wrap(
            line, COLUMNS, initial_indent="", subsequent_indent=f"{indent}  ", break_on_hyphens=False
        )
