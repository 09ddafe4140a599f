"""Programs that end with this one, however it ends: nothing that is started here outlives it."""

import os
import signal
import subprocess
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress

LINKED = ("sh", "-c", 'exec 3<&0 </dev/null; { cat <&3; kill -9 0; } >/dev/null 2>&1 & exec "$@" 3<&-', "sh")
"""Runs a program that is killed, with all that it starts, when its standard input is closed."""


@contextmanager
def child(
    command: Sequence[str], environment: Mapping[str, str], *, out: int | None = None, err: int | None = None
) -> Iterator[subprocess.Popen[bytes]]:
    """A program in the block, killed with all that it starts when the block or this process ends.

    The kernel closes its standard input, a pipe, when this process is gone, and a process beside it, which
    waits for that, kills its group. No signal of a terminal reaches it: this process heeds them for all.
    (`Popen.communicate` in the block would close that pipe too.)

    Args:
        command: The program and its arguments.
        environment: Its whole environment.
        out: Its standard output, as of `subprocess.Popen`; None for ours.
        err: Its standard error.
    """
    process = subprocess.Popen(
        [*LINKED, *command],
        env=environment,
        stdin=subprocess.PIPE,
        stdout=out,
        stderr=err,
        start_new_session=True,
    )
    try:
        yield process
    finally:
        with suppress(ProcessLookupError):  # it may have ended by itself
            os.killpg(process.pid, signal.SIGKILL)
        process.communicate()
