"""Trials on a Dask cluster that somebody runs: its scheduler and workers are not ours to start or stop.

Whoever reaches a Dask scheduler runs programs on its workers, and its answers are unpickled here. So it is
tls://, with both sides proving who they are, or this machine, or said aloud to be insecure. docs/cluster.md
says how one is started.
"""

import asyncio
import contextlib
import ipaddress
import logging
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import CancelledError
from functools import partial
from typing import Any
from urllib.parse import urlsplit

from threadpoolctl import threadpool_limits

from testbench.errors import BenchError
from testbench.runs.engine import Chunk, Chunks, Work, WorkersLost, do_chunk
from testbench.runs.store import numeric_versions

PATIENCE = 10.0  #: Time that scheduler and workers have to answer [s].
POLL, LOOK = 0.01, 500  #: Time between looks for results [s]; looks without any before one for workers.
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
        if looks % LOOK == 0 and not client.nthreads():
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
