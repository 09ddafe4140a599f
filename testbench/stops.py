"""Signals that end a command in good order. Imports nothing but what Python has loaded."""

import contextlib
import signal
from collections.abc import Callable, Iterator, Mapping

STOPS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
"""Ctrl-C, a supervisor's request, the loss of the terminal."""
Handler = Callable[..., object] | int | None
Handlers = Mapping[int, Handler]


def handle(handler: Callable[..., object]) -> Handlers:
    """Make it the handler of the stops, but for those that are ignored; returns those before.

    Ignored is what must not interrupt: by nohup, or for a job in the background.
    """
    before: dict[int, Handler] = {}
    for number in STOPS:
        if signal.getsignal(number) not in (signal.SIG_IGN, None):
            before[number] = signal.signal(number, handler)
    return before


def restore(before: Handlers) -> None:
    """Make the earlier ones the handlers again."""
    for number, handler in before.items():
        signal.signal(number, handler)


@contextlib.contextmanager
def stops_wait() -> Iterator[None]:
    """Stops wait for the end of the block.

    To block them in this thread would not do: Python heeds them in its main thread, whichever gets them.
    """
    came: list[int] = []
    try:
        before = handle(lambda number, _: came.append(number))
    except ValueError:  # in another thread than the main one, which no stop interrupts
        yield
        return
    try:
        yield
    finally:
        restore(before)
        if came:
            signal.raise_signal(came[0])
