"""A command under way: its session, and Ctrl-C and its like at any moment: one line, an exit code.

It imports next to nothing: it is there before anything else.
"""

import contextlib
import gc
import os
import signal
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from typing import NamedTuple

STOPS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
"""Ctrl-C, a supervisor's request, the loss of the terminal: signals that end a command in good order."""


class Session(NamedTuple):
    """Hold a command under way."""

    project: Mapping[str, object]  #: Name and SHA-256 of the project file, the values taken; empty for none.
    known: frozenset[str]  #: Keys that it has, taken or not.
    prints: bool = False  #: Whether figures are written for print too.
    log: Callable[[], str] = str  #: What happened so far, for run.log; empty where nobody follows.

    @property
    def taken(self) -> frozenset[str]:
        """List the keys of the project file whose values were taken."""
        found = self.project.get("taken")
        return frozenset(found if isinstance(found, Mapping) else ())


EMPTY_SESSION = Session({}, frozenset())
SESSION: ContextVar[Session] = ContextVar("session", default=EMPTY_SESSION)  #: Of the command that runs.


@contextmanager
def session(own: Session) -> Iterator[None]:
    """Make a command the one that runs in the block."""
    token = SESSION.set(own)
    try:
        yield
    finally:
        SESSION.reset(token)


SIGNALLED = 128  #: Exit code after a signal, less its number.
INTERRUPTED = SIGNALLED + signal.SIGINT
RESULTS_KEPT = "earlier results are unchanged"


def handle(handler: Callable[..., object]) -> dict[int, Callable[..., object] | int | None]:
    """Make it the handler of the stops, but for those that are ignored; returns those before.

    Ignored is what must not interrupt: by nohup, or for a job in the background.
    """
    heeded = [number for number in STOPS if signal.getsignal(number) not in (signal.SIG_IGN, None)]
    return {number: signal.signal(number, handler) for number in heeded}


def leave_at_once(number: int, _: object) -> None:
    """End the program where it is; a handler of signals.

    For imports, which have nothing to clean up and whose C code may make other errors of an exception, and
    for whoever presses Ctrl-C again while the program cleans up.

    Args:
        number: Number of the signal.
        _: Not used.
    """
    if sys.stderr is not None:  # else a file of ours may have its number
        with contextlib.suppress(OSError):
            os.write(2, f"interrupted: {RESULTS_KEPT}\n".encode())
    os._exit(SIGNALLED + number)


@contextlib.contextmanager
def raised() -> Iterator[Callable[[], int]]:
    """Raise KeyboardInterrupt at a stop inside of the block; the next stop ends the program at once.

    Yields:
        The exit code of the stop that came, 0 if none did: an error of another kind is then one that C code
        made of it.
    """
    came: list[int] = []

    def first(number: int, _: object) -> None:
        came.append(number)
        handle(leave_at_once)
        raise KeyboardInterrupt

    before = handle(first)
    try:
        yield lambda: SIGNALLED + came[0] if came else 0
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def leave(code: int) -> None:
    """End the program; stops have nothing to stop any more.

    Raises:
        SystemExit: Always.
    """
    for number in STOPS:
        signal.signal(number, signal.SIG_IGN)
    gc.freeze()  # Python ends with a search of all objects for garbage: a fifth of a command's time
    sys.exit(code)
