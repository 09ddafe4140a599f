"""A command under way: its session, and Ctrl-C and its like at any moment: one line, an exit code.

It imports next to nothing: it is there before anything else.
"""

import contextlib
import gc
import os
import signal
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, redirect_stdout
from contextvars import ContextVar
from datetime import UTC, datetime
from io import StringIO
from pathlib import Path
from typing import NamedTuple

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TaskID, TextColumn, TimeRemainingColumn

from testbench.errors import printable
from testbench.progress import listening

# --- A command under way: its session, and Ctrl-C and its like at any moment: one line, an exit code --------

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
RESULTS_KEPT = "earlier results stand as they were"


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


# --- Progress of a command: bars with the time left on a terminal, and run.log beside the manifest ----------

COLUMNS = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
"""Of every bar: what is done, how many of how many, the time left."""

REMEMBERED = 600.0  #: Time over which the speed is averaged, for the time left [s].
SHORT = 0.05  #: What takes less has no line in run.log [s].


class Follower:
    """Follow a command; its bars are on standard error, so that a pipe has the results alone."""

    def __init__(self, *, quiet: bool) -> None:
        self.began, self.begun, self.tasks = time.monotonic(), dict[str, float](), dict[str, TaskID]()
        words = printable(" ".join([Path(sys.argv[0]).name, *sys.argv[1:]]))
        self.lines = [f"{datetime.now(UTC):%Y-%m-%d %H:%M:%S} UTC  {words}"]
        console = Console(stderr=True)
        self.bars = Progress(
            *COLUMNS,
            console=console,
            transient=True,
            speed_estimate_period=REMEMBERED,
            redirect_stdout=False,
            redirect_stderr=False,
            disable=quiet or not console.is_terminal,
        )

    def follow(self, words: str, done: int, total: int) -> None:
        """Show that some steps of a kind are done; bars stand while any is under way.

        Args:
            words: Kind of step.
            done: Number of finished steps.
            total: Number of all steps.
        """
        now = time.monotonic() - self.began
        if words not in self.tasks:
            self.begun[words], self.tasks[words] = now, self.bars.add_task(words, total=total)
            self.bars.start()
        self.bars.update(self.tasks[words], completed=done, total=total)
        if done >= total:
            if now - self.begun[words] > SHORT:
                self.lines.append(f"{self.begun[words]:9.2f} s  {words}: {now - self.begun[words]:.2f} s")
            self.bars.remove_task(self.tasks.pop(words))
        if not self.tasks:
            self.bars.stop()

    def log(self) -> str:
        """Write when the command began, its words, and of every kind of steps beginning and length."""
        return "\n".join([*self.lines, f"{time.monotonic() - self.began:9.2f} s  files are written", ""])


@contextmanager
def followed(own: Session, *, quiet: bool) -> Iterator[None]:
    """Run the block as a command with its log; quiet, it prints nothing but errors.

    Args:
        own: The session.
        quiet: Whether nothing is printed.

    Yields:
        Nothing.
    """
    follower = Follower(quiet=quiet)
    with ExitStack() as held:
        held.callback(follower.bars.stop)
        if quiet:
            held.enter_context(redirect_stdout(StringIO()))
        held.enter_context(listening(follower.follow))
        held.enter_context(session(own._replace(log=follower.log)))
        yield
