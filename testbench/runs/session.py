"""A command under way: what it took from a project file, and the log that it leaves."""

import signal
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
        """Keys of the project file whose values were taken."""
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
