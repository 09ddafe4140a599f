"""Progress of long steps: library functions report it, and whoever follows is called."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from typing import TypeVar

T = TypeVar("T")
Listener = Callable[[str, int, int], None]  #: Called with the kind of steps, how many are done, of how many.


def _ignore(_: str, done: int, total: int) -> None:
    """Follow nothing."""


LISTENER: ContextVar[Listener] = ContextVar("listener", default=_ignore)  #: Who follows at the moment.


@contextmanager
def listening(listener: Listener) -> Iterator[None]:
    """Call a listener for every step that is done inside the block."""
    token = LISTENER.set(listener)
    try:
        yield
    finally:
        LISTENER.reset(token)


def tell(words: str, done: int, total: int) -> None:
    """Report to the listener how many steps are done.

    Args:
        words: The kind of steps, as "readings are fitted".
        done: How many are done.
        total: How many there are.
    """
    LISTENER.get()(words, done, total)


def stepwise(items: Sequence[T], words: str) -> Iterator[T]:
    """Iterate over items and report after each how many are done; all of them at the end, even an early one.

    Args:
        items: What is iterated over; fewer than two are not reported.
        words: The kind of steps, as "readings are fitted".
    """
    if len(items) < 2:
        yield from items
        return
    try:
        for k, item in enumerate(items):
            tell(words, k, len(items))
            yield item
    finally:
        tell(words, len(items), len(items))
