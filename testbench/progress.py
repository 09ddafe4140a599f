"""Progress of long computations: library functions report it, and a listener shows it."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from typing import TypeVar

T = TypeVar("T")
Listener = Callable[[str, int, int], None]  #: Called with the kind of steps, the number done, and the total.


def _ignore(_: str, done: int, total: int) -> None:
    """Do nothing."""


LISTENER: ContextVar[Listener] = ContextVar("listener", default=_ignore)  #: The listener of this context.


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
        words: The kind of steps, such as "readings are fitted".
        done: Number of steps done.
        total: Number of all steps.
    """
    LISTENER.get()(words, done, total)


def stepwise(items: Sequence[T], words: str) -> Iterator[T]:
    """Iterate over items and report progress after each; when the iteration ends early, all count as done.

    Args:
        items: The items; fewer than two are not reported.
        words: The kind of steps, such as "readings are fitted".

    Yields:
        Every item.
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
