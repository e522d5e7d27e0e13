"""Which place works, by what the user asks for."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from enginediag_cli.fleets.runners.runner import Runner
from enginediag_cli.fleets.runners.serial import Serial


@contextmanager
def runner_for(jobs: int, scheduler: str = "") -> Iterator[Runner]:
    """This process for one job, so many processes, or the cluster of a Dask scheduler. Raises DataError."""
    runner: Runner
    if scheduler:
        from enginediag_cli.fleets.runners.on_dask import OnDask

        runner = OnDask(scheduler)
    elif jobs == 1:
        runner = Serial()
    else:
        from enginediag_cli.fleets.runners.processes import Processes

        runner = Processes(jobs)
    try:
        yield runner
    finally:
        runner.close()
