"""A lock on a file, for one run at a time. The system releases it when its holder ends, however it ends."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress

from enginediag_cli.errors import DataError, EngineDiagError, ExitCode

OPENING = b"process "
"""How a lock file begins once it was used; a file that begins otherwise is something else and is left alone."""

RETRY_S = 0.2
"""Pause between attempts: short beside any run, long beside what an attempt costs."""

SHOWN_BYTES = 300
"""Of a lock file that are read: it holds one short line."""


class LockedError(EngineDiagError):
    """Another run holds the lock; the same command may succeed later (EX_TEMPFAIL of sysexits.h)."""

    exit_code = ExitCode.LOCKED


@contextmanager
def lock_file(path: str, command: str, wait_s: float = 0.0) -> Iterator[None]:
    """Hold the lock of a file inside the block. The file is made where there is none, and stays.

    Parameters
    ----------
    path
        Lock file.
    command
        Name of the command that holds the lock, written into the file for whoever waits.
    wait_s
        How long to wait for another holder [s].

    Raises
    ------
    LockedError
        Another run still holds the lock after `wait_s`.
    DataError
        The file is something else or cannot be opened, or the system has no file locks.
    """
    try:
        import fcntl
    except ImportError:
        raise DataError("--lock: this system has no file locks") from None
    try:
        handle = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o666)
    except OSError as error:
        raise DataError(f"--lock {path}: cannot be opened: {error.strerror}") from None
    try:
        until = time.monotonic() + wait_s
        text = os.pread(handle, SHOWN_BYTES, 0)
        if text and not text.startswith(OPENING):
            raise DataError(f"--lock {path}: the file exists and is no lock file; name another one")
        while True:
            try:
                fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
                break
            except OSError as error:
                if not isinstance(error, BlockingIOError):
                    raise DataError(f"--lock {path}: cannot be locked: {error.strerror}") from None
            if time.monotonic() >= until:
                raise LockedError(f"--lock {path}: {_holder(handle)} holds the lock; nothing was done, try again later")
            time.sleep(min(RETRY_S, max(until - time.monotonic(), 0.0)))
        since = time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime())
        with suppress(OSError):  # a disk without room can be locked all the same
            os.ftruncate(handle, 0)
            os.pwrite(handle, f"process {os.getpid()}, enginediag {command}, since {since}\n".encode(), 0)
        yield
    finally:
        os.close(handle)


def try_lock(handle: int) -> bool:
    """Lock an open file until it is closed, without waiting; whether it was possible."""
    try:
        import fcntl

        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except (ImportError, OSError):  # held by another, or a file system that has no locks
        return False
    return True


def _holder(handle: int) -> str:
    """Description of the run that holds the lock, from the file."""
    return os.pread(handle, SHOWN_BYTES, 0).decode("utf-8", "replace").split("\n")[0] or "another run"
