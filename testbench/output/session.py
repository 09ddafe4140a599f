"""What a command says of itself beside its numbers: what it took from a project file."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from typing import NamedTuple


class Session(NamedTuple):
    """A command under way."""

    project: Mapping[str, object]  #: Name and SHA-256 of the project file, the values taken; empty for none.
    known: frozenset[str]  #: Keys that it has, taken or not.


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
