"""Which place works, by what the user asks for."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from enginediag_cli.fleet.runners.runner import Runner
from enginediag_cli.fleet.runners.serial import Serial


@contextmanager
def runner_for(jobs: int) -> Iterator[Runner]:
    """This process for one job, or so many processes."""
    if jobs == 1:
        yield Serial()
        return
    from enginediag_cli.fleet.runners.processes import Processes

    runner = Processes(jobs)
    try:
        yield runner
    finally:
        runner.close()
