"""A progress bar for trials."""

from collections.abc import Iterator

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from testbench.errors import Interrupted
from testbench.shell.interrupt import STANDS

REMEMBERED = 600.0  #: Time over which the speed is averaged, for the time left [s].


def show_progress(counts: Iterator[int], total: int, words: str, console: Console) -> None:
    """Run a study with a bar that shows how many trials are done and the time left.

    Args:
        counts: From `run_study`.
        total: Trials of the study.
        words: What a trial is, such as "seeds".
        console: Where to.

    Raises:
        Interrupted: After Ctrl-C; says what is stored.
    """
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
    )
    done = next(counts, 0)
    try:
        with Progress(*columns, console=console, transient=True, speed_estimate_period=REMEMBERED) as bar:
            task = bar.add_task(words, total=total, completed=done)
            for done in counts:
                bar.update(task, completed=done)
    except KeyboardInterrupt as err:
        if not done:
            raise
        stored = f"at least {done} of {total} {words} are stored: --resume goes on with them"
        raise Interrupted(f"{STANDS}; {stored}") from err
