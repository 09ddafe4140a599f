"""Where the trials of a command run: on the cores of this machine, or on a cluster."""

from functools import partial

from testbench.errors import BenchError
from testbench.shell.options import Common
from testbench.trials.chunk import Backend
from testbench.trials.cluster import check_address, check_certificates, on_cluster
from testbench.trials.local import on_cores


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
