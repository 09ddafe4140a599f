"""The engine: it does the trials that a store lacks, in chunks, on the cores of this machine or elsewhere.

Trials on a Dask cluster that somebody runs: its scheduler and workers are not ours to start or stop.

Whoever reaches a Dask scheduler runs programs on its workers, and its answers are unpickled here. So it is
tls://, with both sides proving who they are, or this machine, or said aloud to be insecure. docs/cluster.md
says how one is started.
"""

import asyncio
import contextlib
import ipaddress
import logging
import os
import signal
import time
import warnings
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import CancelledError
from concurrent.futures.process import BrokenProcessPool
from contextlib import closing
from dataclasses import dataclass
from functools import partial
from multiprocessing import resource_tracker
from threading import Thread
from typing import Any
from urllib.parse import urlsplit

import scipy.linalg  # noqa: F401 - its BLAS has to be loaded before it can be limited
from joblib import Parallel, cpu_count, delayed, parallel_config
from threadpoolctl import threadpool_limits

from testbench.errors import BenchError
from testbench.runs.interrupt import STOPS
from testbench.runs.store import TrialStore, numeric_versions

# --- The engine: trials in chunks, on the cores of this machine ---------------------------------------------

RETRIES = 3  #: Times in a row that workers may be lost without a single new result.
Found = Sequence[object]
Work = Callable[[Sequence[int]], Sequence[Found]]
"""Does the trials of some seeds: one sequence of rows a seed, in their order.

It is a function of a module, or a partial of one, and what it is given are names, numbers and settings: arms
and arrays it builds itself, once a chunk. An array that was sent to a worker may lie otherwise in memory,
which changes the last digits that BLAS gives, and results would depend on where they were computed.
Randomness comes from `trial_rng` and the seed. Clocks in the rows are `solve_seconds` and `cpu_seconds`, of a
fit.
"""


@dataclass(frozen=True)
class Chunk:
    """Hold trials that a worker has done."""

    seeds: Sequence[int]  #: Of the trials.
    found: Sequence[Found]  #: Their rows.
    problem: str = ""  #: Why there are none; empty if all is well.


class WorkersLost(BenchError):
    """Report that workers died, or the cluster went away, with trials under way."""


Chunks = Generator[Chunk, None, None]
Backend = Callable[[Work, Sequence[Sequence[int]]], Chunks]
"""Runs the work on chunks of seeds and gives them back as they are done, in any order.

It raises WorkersLost where trials may be done again; closed, it stops.
"""


def do_chunk(work: Work, seeds: Sequence[int]) -> Chunk:
    """Do trials with one BLAS thread; a problem comes back as words, since not every exception can travel.

    Args:
        work: Does the trials of some seeds.
        seeds: Seeds of the trials.

    Returns:
        The rows of the seeds, or the problem in words.
    """
    try:
        with threadpool_limits(1):
            found = work(seeds)
        if len(found) != len(seeds):
            raise BenchError(f"expected rows for {len(seeds)} trials, got {len(found)}")
        return Chunk(seeds, found)
    except (BenchError, ImportError, OSError) as err:
        these = f"seed {seeds[0]}" if len(seeds) == 1 else f"seeds {seeds[0]} to {seeds[-1]}"
        return Chunk(seeds, (), f"{these}: {err}")


def here(work: Work, chunks: Sequence[Sequence[int]]) -> Chunks:
    """Do the trials in this process.

    Args:
        work: Does the trials of some seeds.
        chunks: Seeds of every chunk.

    Returns:
        Chunks as they are done.
    """
    return (do_chunk(work, seeds) for seeds in chunks)


def run_study(
    work: Work, store: TrialStore[Any], backend: Backend, *, size: int = 1, remote: bool = False
) -> Iterator[int]:
    """Do all trials that are not stored yet.

    Results depend on the seeds alone: not on the backend, its workers, the order in which they finish, or on
    where a run was stopped and resumed. (Processors of another kind give other last digits.) See `Work`
    for what keeps them bit-equal. A chunk has `size` seeds, 0.1 to 1 s of work: a stop loses the chunks under
    way. A study that is one chunk is done by this process, but where the backend is `remote`, which somebody
    asked for; what is left of a larger one is not, as it may be what workers die of.

    Args:
        work: Does the trials of some seeds.
        store: Where rows are stored.
        backend: Does the chunks.
        size: Seeds of a chunk.
        remote: Whether the backend is on other machines.

    Yields:
        Number of finished trials, first of those from before.

    Raises:
        BenchError: When a trial cannot be done, the store cannot be written, or workers die again and again.
    """
    done = store.count
    lost = 0
    every = len(store.experiment.seeds)
    backend = here if every <= size and not remote else backend
    yield done
    while done < every:
        before = done
        try:
            for done in _attempt(work, store, backend, size):
                yield done
        except WorkersLost as err:
            lost = 1 if done > before else lost + 1
            if lost > RETRIES:
                raise _resumable(f"{err} ({lost} times in a row)", store) from err
        except BenchError as err:
            raise _resumable(str(err), store) from err


def _attempt(work: Work, store: TrialStore[Any], backend: Backend, size: int) -> Iterator[int]:
    missing = store.missing()
    todo = [missing[k : k + size] for k in range(0, len(missing), size)]
    with closing(backend(work, todo)) as chunks:
        for chunk in chunks:
            if chunk.problem:
                raise BenchError(chunk.problem)
            store.append(chunk.seeds, chunk.found)
            yield store.count


def _resumable(problem: str, store: TrialStore[Any]) -> BenchError:
    if not store.count:
        return BenchError(problem)
    held = f"{store.count} of {len(store.experiment.seeds)} trials are stored"
    return BenchError(f"{problem}; {held}; --resume continues")


MOST_A_CORE = 8  #: Most processes of a core: each takes the memory of a program.
LOOK = 0.2  #: Time between two looks of a worker for the process that started it [s].


def on_cores(work: Work, chunks: Sequence[Sequence[int]], *, workers: int | None = None) -> Chunks:
    """Run trials on this machine, in at most so many processes; one a core if None.

    No more than there are chunks; if it may be one only, that is this process.

    Args:
        work: Does the trials of some seeds.
        chunks: Seeds of every chunk.
        workers: Number of processes; None for one per core.

    Returns:
        Chunks as they are done.

    Raises:
        BenchError: When workers is below 1, or more than help.
        WorkersLost: When a process was killed.
    """
    cores = cpu_count()
    highest = MOST_A_CORE * cores
    if workers is not None and not 1 <= workers <= highest:
        raise BenchError(f"workers: expected 1 to {highest} ({MOST_A_CORE} per core), got {workers}")
    count = min(workers or cores, len(chunks))
    if count <= 1:
        yield from here(work, chunks)
        return
    # A stop cancels tasks, which the user has asked for: no warning.
    warnings.filterwarnings("ignore", r"\d+ tasks (have been|which were still)", UserWarning)
    # One BLAS thread, and arrays as they are: where they lie in memory changes the last digits of results.
    options = {"inner_max_num_threads": 1, "initializer": _begin, "initargs": (os.getpid(),)}
    try:
        with (
            parallel_config("loky", **options),
            Parallel(count, return_as="generator_unordered", batch_size=1, max_nbytes=None) as pool,
        ):
            # No stop reaches a worker before it has begun: it would say so with a traceback. On Python 3.11
            # the resource tracker, which the first worker would start, unblocks stops.
            resource_tracker.ensure_running()
            signal.pthread_sigmask(signal.SIG_BLOCK, STOPS)
            try:
                found = pool(delayed(do_chunk)(work, seeds) for seeds in chunks)
            finally:
                signal.pthread_sigmask(signal.SIG_UNBLOCK, STOPS)
            yield from found
    except BrokenProcessPool as err:
        raise WorkersLost("a worker was killed, or crashed, or ran out of memory") from err


def _begin(parent: int) -> None:
    """Have this worker leave stops to the process that started it, and end soon after that one."""
    for number in STOPS:
        signal.signal(number, signal.SIG_IGN)

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(LOOK)
        os._exit(1)

    Thread(target=watch, daemon=True).start()


# --- Trials on a Dask cluster that somebody runs ------------------------------------------------------------

PATIENCE = 10.0  #: Time that scheduler and workers have to answer [s].
POLL, LOOKS_PER_CHECK = (
    0.01,
    500,
)  #: Time between looks for results [s]; looks without any before one for workers.
LOGS = ("distributed", "distributed.client")
EXTRA = "--cluster needs the extra packages: pip install 'testbench[cluster]'"
TLS = (
    "DASK_DISTRIBUTED__COMM__TLS__CA_FILE, DASK_DISTRIBUTED__COMM__TLS__CLIENT__CERT and "
    "DASK_DISTRIBUTED__COMM__TLS__CLIENT__KEY, or ~/.config/dask/distributed.yaml"
)


def check_address(address: str, *, insecure: bool = False) -> None:
    """Refuse a scheduler's address, such as "tls://host:8786", that is wrong or would let others in.

    Args:
        address: The scheduler's address.
        insecure: Whether plain tcp:// to this machine is accepted.

    Raises:
        BenchError: When it is neither tls:// nor, unless insecure, plain tcp:// on this machine.
    """
    expected = "expected tls://host:port, or tcp://127.0.0.1:port on this machine"
    try:
        parts = urlsplit(address)
        host, port = parts.hostname, parts.port
    except ValueError as err:
        raise BenchError(f"--cluster: {expected}, got {address!r}: {err}") from err
    whole = parts.scheme in ("tls", "tcp") and host and port
    if not whole or parts.username is not None or parts.path or parts.query or parts.fragment:
        raise BenchError(f"--cluster: {expected}, got {address!r}")
    if parts.scheme == "tcp" and not insecure and not _is_here(str(host)):
        raise BenchError(
            f"--cluster: {expected}, got {address!r}: plain tcp:// lets anybody on the network "
            "run programs on both machines; --insecure allows it"
        )


def check_certificates(address: str) -> None:
    """Refuse what a scheduler of tls:// is not reached with: Dask's settings without sound certificates.

    Raises:
        BenchError: When there are none, they cannot be read, or the extra packages are missing.
    """
    try:
        _security(address)
    except ImportError as err:
        raise BenchError(EXTRA) from err


def _is_here(host: str) -> bool:
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def on_cluster(
    work: Work,
    chunks: Sequence[Sequence[int]],
    *,
    address: str,
    insecure: bool = False,
    patience: float = PATIENCE,
) -> Chunks:
    """Do trials on a Dask cluster; trials of a lost worker are done by others.

    Certificates of tls:// are those of Dask's own settings. The module of the work has to be installed on the
    workers, which have `patience` seconds to answer, as the scheduler has.

    Args:
        work: Does the trials of some seeds.
        chunks: Seeds of every chunk.
        address: The scheduler's address.
        insecure: Whether plain tcp:// to this machine is accepted.
        patience: Time for workers and scheduler to answer [s].

    Returns:
        Chunks as they are done.

    Raises:
        BenchError: When the address is refused, nobody answers there, or a worker has other packages than we.
        WorkersLost: When the scheduler, or every worker, went away.
    """
    check_address(address, insecure=insecure)
    with _connected(address, patience) as client:
        _check_workers(client, address, patience)
        with _losses():
            yield from _results(client, partial(_do, work), chunks)


@contextlib.contextmanager
def _connected(address: str, patience: float) -> Iterator[Any]:
    try:
        from distributed import Client  # 0.5 s, and an extra
    except ImportError as err:
        raise BenchError(EXTRA) from err
    security = _security(address)
    with _quiet():
        _greet(address, security, patience)
        client = Client(address, timeout=patience, security=security, set_as_default=False)
        try:
            yield client
        finally:
            client.close(timeout=patience)


def _greet(address: str, security: Any, patience: float) -> None:
    """Shake hands once: a client would wait for ever where something else than a scheduler listens."""
    from distributed.comm.core import connect

    async def greet() -> None:
        hello = connect(address, timeout=patience, **security.get_connection_args("client"))
        (await asyncio.wait_for(hello, patience)).abort()

    try:
        asyncio.run(greet())
    except Exception as err:  # what a stranger's port answers may break anything on the way
        doubt = ", or none with a certificate that fits ours" if address.startswith("tls:") else ""
        raise BenchError(f"--cluster: no scheduler answers at {address}{doubt}") from err


def _security(address: str) -> Any:
    """Certificates from Dask's settings, looked at before a client waits with what it lacks."""
    from distributed import Security

    encrypted = address.startswith("tls:")
    security = Security(require_encryption=True) if encrypted else Security()
    try:
        context = security.get_connection_args("client").get("ssl_context")
    except (OSError, ValueError) as err:  # no file, no certificate, no key of it
        raise BenchError(f"--cluster: certificates: {err}; they are set by {TLS}") from err
    if encrypted and context is None:
        raise BenchError(f"--cluster: {address} needs certificates: set {TLS}")
    return security


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Without Dask's log: what fails is raised here, and told in one line."""
    levels = {log: log.level for log in map(logging.getLogger, LOGS)}
    for log in levels:
        log.setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        for log, level in levels.items():
            log.setLevel(level)


def _check_workers(client: Any, address: str, patience: float) -> None:
    """Every worker must compute as we do: the same packages in the same versions."""
    try:
        client.wait_for_workers(1, timeout=patience)
    except TimeoutError as err:
        raise BenchError(f"--cluster: the scheduler at {address} has no workers") from err
    advice = "install the same checkout and requirements.lock there"
    for worker, found in client.run(numeric_versions, on_error="return").items():
        if not isinstance(found, dict):
            raise BenchError(f"--cluster: worker {worker} does not report its versions: {found!r}; {advice}")
        for name, here in numeric_versions().items():
            if found.get(name) != here:
                raise BenchError(
                    f"--cluster: worker {worker}: expected {name} {here}, as on this machine, "
                    f"got {found.get(name, 'none')}; {advice}"
                )


def _do(work: Work, seeds: Sequence[int]) -> Chunk:
    """A chunk in a worker with several threads, perhaps: a limit that one lifts would be lifted for all."""
    threadpool_limits(1)
    return do_chunk(work, seeds)


def _results(client: Any, task: Callable[[Sequence[int]], Chunk], chunks: Sequence[Sequence[int]]) -> Chunks:
    from distributed import as_completed

    under_way = as_completed(client.map(task, chunks, pure=False), loop=client.loop, with_results=True)
    try:
        while under_way.count():
            _wait(client, under_way)
            _, chunk = next(under_way)
            if not isinstance(chunk, Chunk):  # a future that was cancelled, not by us
                raise WorkersLost("--cluster: the scheduler dropped the trials")
            yield chunk
    finally:
        with contextlib.suppress(OSError, TimeoutError, CancelledError):
            client.cancel(list(under_way.futures))


def _wait(client: Any, under_way: Any) -> None:
    looks = 0
    while not under_way.has_ready():
        time.sleep(POLL)
        looks += 1
        if looks % LOOKS_PER_CHECK == 0 and not client.nthreads():
            raise WorkersLost("--cluster: no worker is left")


@contextlib.contextmanager
def _losses() -> Iterator[None]:
    """What the cluster's failures mean to us."""
    from distributed import KilledWorker

    try:
        yield
    except KilledWorker as err:
        raise WorkersLost("--cluster: a trial's workers died, one after the other") from err
    except (OSError, TimeoutError, CancelledError) as err:
        raise WorkersLost("--cluster: the connection to the scheduler broke") from err
    except ImportError as err:
        raise BenchError(f"--cluster: a worker cannot import what a trial needs: {err}") from err
