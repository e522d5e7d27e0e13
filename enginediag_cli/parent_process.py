"""Processes that end with the one that started them, even when that is killed and can end nothing any more."""

from __future__ import annotations

import os
import signal
import sys
import threading
import time

SET_DEATH_SIGNAL = 1
"""PR_SET_PDEATHSIG of Linux's prctl(2)."""

WATCH_S = 1.0
"""How often a process looks for its parent where the system does not tell it; costs microseconds."""


def end_with_parent(parent: int) -> None:
    """Have this process killed when its parent, process `parent`, is gone.

    To be called from the process's first thread, by one whose parent's first thread started it: Linux sends the signal
    when that thread ends. Elsewhere a thread looks whether the parent is still there.
    """
    if not _system_tells():
        threading.Thread(target=_watch, args=(parent,), name="parent watch", daemon=True).start()
    if _orphaned(parent):  # the parent died before the system was asked
        os._exit(1)


def _system_tells() -> bool:
    if not sys.platform.startswith("linux"):
        return False
    import ctypes

    try:
        return ctypes.CDLL(None, use_errno=True).prctl(SET_DEATH_SIGNAL, signal.SIGKILL, 0, 0, 0) == 0
    except (OSError, AttributeError):  # a C library without it
        return False


def _watch(parent: int) -> None:
    while not _orphaned(parent):
        time.sleep(WATCH_S)
    os._exit(1)


def _orphaned(parent: int) -> bool:
    """Whether the parent is gone. A POSIX system hands orphans to another parent; Windows keeps the number."""
    if os.name == "posix":
        return os.getppid() != parent
    from multiprocessing import parent_process

    started_by = parent_process()
    return started_by is not None and not started_by.is_alive()
