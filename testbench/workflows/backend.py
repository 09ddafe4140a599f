"""Trials of a command: where they run, and a bar that shows how many are done."""

from collections.abc import Iterator
from functools import partial

from testbench.errors import BenchError, Interrupted
from testbench.progress import tell
from testbench.runs.cluster import check_address, check_certificates, on_cluster
from testbench.runs.engine import Backend, on_cores
from testbench.runs.interrupt import RESULTS_KEPT
from testbench.workflows.options import Common


def choose_backend(common: Common) -> Backend:
    """Choose the backend that a command line asks for.

    Raises:
        BenchError: When it asks for both, or the cluster's address or certificates are refused.
    """
    if common.cluster is None:
        return partial(on_cores, workers=common.workers)
    if common.workers is not None:
        raise BenchError("--workers counts processes of this machine: expected it without --cluster")
    check_address(common.cluster, insecure=common.insecure)
    check_certificates(common.cluster)
    return partial(on_cluster, address=common.cluster, insecure=common.insecure)


def show_progress(counts: Iterator[int], total: int, words: str, *, kept: bool = True) -> None:
    """Run a study; whoever follows is told how many trials are done.

    Args:
        counts: Yields the number of finished trials.
        total: Number of all trials.
        words: Kind of trial.
        kept: Whether finished trials are stored.

    Raises:
        Interrupted: After Ctrl-C; says what is stored, where trials are `kept`.
    """
    done = next(counts, 0)
    try:
        tell(words, done, total)
        for done in counts:
            tell(words, done, total)
    except KeyboardInterrupt as err:
        if not done or not kept:
            raise
        stored = f"at least {done} of {total} {words} are stored: --resume goes on with them"
        raise Interrupted(f"{RESULTS_KEPT}; {stored}") from err
