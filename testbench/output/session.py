"""What a command says of itself beside its numbers: what it took from a project file."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field


@dataclass(frozen=True)
class Session:
    """One command under way."""

    #: Of the project file its name, SHA-256 and the values that were taken; empty where there is none.
    project: Mapping[str, object] = field(default_factory=dict)
    known: frozenset[str] = frozenset()  #: Keys that the project file has, taken or not.


NONE = Session()
SESSION: ContextVar[Session] = ContextVar("session", default=NONE)  #: Of the command that runs.


@contextmanager
def session(own: Session) -> Iterator[None]:
    """A command runs in the block."""
    token = SESSION.set(own)
    try:
        yield
    finally:
        SESSION.reset(token)
