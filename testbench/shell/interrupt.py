"""Ctrl-C at any moment: one line, exit code 130, no traceback. Imports nothing but what Python has loaded."""

import contextlib
import os
import signal
import sys
from collections.abc import Callable, Iterator

INTERRUPTED = 130
STANDS = "earlier results stand as they were"


def leave_at_once(*_: object) -> None:
    """Handler that ends the program where it is.

    For imports, which have nothing to clean up and whose C code may make other errors of an exception, and
    for whoever presses Ctrl-C again while the program cleans up.
    """
    if sys.stderr is not None:  # else a file of ours may have its number
        with contextlib.suppress(OSError):
            os.write(2, f"interrupted: {STANDS}\n".encode())
    os._exit(INTERRUPTED)


def handle(handler: Callable[..., object]) -> object:
    """Make it the handler of Ctrl-C, unless nobody is to be interrupted; returns the one before."""
    before = signal.getsignal(signal.SIGINT)
    if before is not signal.SIG_IGN:  # ignored by nohup, or for a job in the background
        signal.signal(signal.SIGINT, handler)
    return before


@contextlib.contextmanager
def raised() -> Iterator[Callable[[], bool]]:
    """Ctrl-C raises KeyboardInterrupt inside of the block, and the next one ends the program at once.

    Yields:
        Whether it was pressed: then an error of another kind is one that C code made of it.
    """

    def first(*_: object) -> None:
        signal.signal(signal.SIGINT, leave_at_once)
        raise KeyboardInterrupt

    before = handle(first)
    try:
        yield lambda: signal.getsignal(signal.SIGINT) is leave_at_once
    finally:
        if before is not signal.SIG_IGN:
            signal.signal(signal.SIGINT, before)  # type: ignore[arg-type]


def leave(code: int) -> None:
    """End the program; Ctrl-C has nothing to stop any more.

    Raises:
        SystemExit: Always.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    sys.exit(code)
