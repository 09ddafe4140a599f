"""Progress of a command: bars with the time left on a terminal, and run.log beside the manifest."""

import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, redirect_stdout
from datetime import UTC, datetime
from io import StringIO
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TaskID, TextColumn, TimeRemainingColumn

from testbench.errors import printable
from testbench.progress import listening
from testbench.runs.interrupt import Session, session

COLUMNS = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
"""Of every bar: what is done, how many of how many, the time left."""

REMEMBERED = 600.0  #: Time over which the speed is averaged, for the time left [s].
SHORT = 0.05  #: What takes less has no line in run.log [s].


class Follower:
    """Follow a command; its bars are on standard error, so that a pipe has the results alone."""

    def __init__(self, *, quiet: bool) -> None:
        self.began = time.monotonic()
        self.begun = dict[str, float]()
        self.tasks = dict[str, TaskID]()
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
        return "\n".join([*self.lines, f"{time.monotonic() - self.began:9.2f} s  writing files", ""])


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
