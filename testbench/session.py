"""A command under way: what it took from a project file, how far it is, and the log that it leaves."""

import signal
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from typing import NamedTuple, TypeVar

T = TypeVar("T")
STOPS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
"""Ctrl-C, a supervisor's request, the loss of the terminal: signals that end a command in good order."""


def _nobody(_: str, done: int, total: int) -> None:
    """Nobody follows."""


class Session(NamedTuple):
    """A command under way."""

    project: Mapping[str, object]  #: Name and SHA-256 of the project file, the values taken; empty for none.
    known: frozenset[str]  #: Keys that it has, taken or not.
    follow: Callable[[str, int, int], None] = _nobody  #: Is told how many steps of a kind are done.
    log: Callable[[], str] = str  #: What happened so far, for run.log; empty where nobody follows.

    @property
    def taken(self) -> frozenset[str]:
        """Keys of the project file whose values were taken."""
        found = self.project.get("taken")
        return frozenset(found if isinstance(found, Mapping) else ())


NONE = Session({}, frozenset())
SESSION: ContextVar[Session] = ContextVar("session", default=NONE)  #: Of the command that runs.


@contextmanager
def session(own: Session) -> Iterator[None]:
    """A command runs in the block."""
    token = SESSION.set(own)
    try:
        yield
    finally:
        SESSION.reset(token)


def tell(words: str, done: int, total: int) -> None:
    """Whoever follows the command is told how many steps are done."""
    SESSION.get().follow(words, done, total)


def stepwise(items: Sequence[T], words: str) -> Iterator[T]:
    """The items; whoever follows is told how many are done, all of them at the end, even an early one."""
    if len(items) < 2:
        yield from items
        return
    try:
        for k, item in enumerate(items):
            tell(words, k, len(items))
            yield item
    finally:
        tell(words, len(items), len(items))
