"""Trials of a command: where they run, and a bar that shows how many are done."""

from collections.abc import Iterator
from functools import partial

from rich.console import Console
from rich.progress import Progress

from testbench.errors import BenchError, Interrupted
from testbench.shell.follow import COLUMNS
from testbench.shell.interrupt import STANDS
from testbench.shell.options import Common
from testbench.trials.cluster import check_address, check_certificates, on_cluster
from testbench.trials.engine import Backend
from testbench.trials.local import on_cores

REMEMBERED = 600.0  #: Time over which the speed is averaged, for the time left [s].


def choose_backend(asked: Common) -> Backend:
    """The backend that a command line asks for.

    Raises:
        BenchError: When it asks for both, or the cluster's address or certificates are refused.
    """
    if asked.cluster is None:
        return partial(on_cores, workers=asked.workers)
    if asked.workers is not None:
        raise BenchError("--workers counts processes of this machine: expected it without --cluster")
    check_address(asked.cluster, insecure=asked.insecure)
    check_certificates(asked.cluster)
    return partial(on_cluster, address=asked.cluster, insecure=asked.insecure)


def show_progress(
    counts: Iterator[int], total: int, words: str, console: Console, *, kept: bool = True
) -> None:
    """Run a study with a bar that shows how many trials are done and the time left.

    Raises:
        Interrupted: After Ctrl-C; says what is stored, where trials are `kept`.
    """
    done = next(counts, 0)
    try:
        with Progress(*COLUMNS, console=console, transient=True, speed_estimate_period=REMEMBERED) as bar:
            task = bar.add_task(words, total=total, completed=done)
            for done in counts:
                bar.update(task, completed=done)
    except KeyboardInterrupt as err:
        if not done or not kept:
            raise
        stored = f"at least {done} of {total} {words} are stored: --resume goes on with them"
        raise Interrupted(f"{STANDS}; {stored}") from err
