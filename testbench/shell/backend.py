"""The command line of every scenario that runs trials."""

from functools import partial
from typing import Annotated

import typer

from testbench.errors import BenchError
from testbench.trials.chunk import Backend
from testbench.trials.cluster import check_address, on_cluster
from testbench.trials.local import on_cores

Workers = Annotated[int | None, typer.Option(min=1, help="Processes; one a core if not given.")]
Cluster = Annotated[
    str | None,
    typer.Option(metavar="tls://HOST:PORT", help="Run the trials on this Dask scheduler's workers."),
]
Insecure = Annotated[bool, typer.Option("--insecure", help="Allow plain tcp:// to another machine.")]
Resume = Annotated[
    bool, typer.Option("--resume", help="Go on with the trials that a stopped run has stored.")
]


def choose_backend(workers: int | None, cluster: str | None, insecure: bool) -> Backend:
    """The backend that a command line asks for.

    Raises:
        BenchError: When it asks for both, or the cluster's address is refused.
    """
    if cluster is None:
        return partial(on_cores, workers=workers)
    if workers is not None:
        raise BenchError("--workers counts processes of this machine: expected it without --cluster")
    check_address(cluster, insecure=insecure)
    return partial(on_cluster, address=cluster, insecure=insecure)
