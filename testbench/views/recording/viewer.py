"""The newest recording of a run; the viewer as a program of its own, in a window, for us or in a browser."""

import http.client
import json
import os
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TypeVar

from testbench.child import child
from testbench.errors import BenchError, InputError
from testbench.output.replace import settle
from testbench.output.whole import temporary_folder

T = TypeVar("T")
HERE = "127.0.0.1"  #: The address of this machine that no other one reaches.
BEGINS = b"RRF2"  #: What a recording of Rerun begins with.
ENDS, LAST = b"RRF2FOOT", 32
"""What stands at the end of one that was closed, and among how many bytes there."""
VERIFIED = b"1 file verified"  #: What the viewer's program says of a sound one.
LOOK_EVERY = 0.25  #: Between two looks at a program that is waited for [s].
START = 30.0  #: Longest wait for the program, and for a file of it [s].
FILES = ("", "re_viewer.js", "re_viewer_bg.wasm", "favicon.ico")
"""What its page consists of, the page first."""
NOTHING = f"http://{HERE}/none.rrd"
"""A recording to be opened by its address: without one the program listens for readings too."""


def newest(folder: Path) -> Path:
    """The newest recording of a run's folder, or of the runs in a folder, by its absolute path.

    A name such as --save=x is a file only so: the viewer would take it for a flag.

    Raises:
        BenchError: When there is none.
        InputError: When it is no recording.
    """
    if folder.is_file() and folder.suffix == ".rrd":
        found = [folder]
    else:
        settle(folder, read=True)
        found = [file for there in ("*.rrd", "*/*.rrd") for file in folder.glob(there)]
        found = [file for file in found if file.is_file()]  # a pipe of that name has no end
    if not found:
        raise BenchError(f"no recording (*.rrd) in {folder}: a scenario writes one into its --out folder")
    file = max(found, key=lambda file: file.stat().st_mtime).absolute()
    with file.open("rb") as opened:
        if opened.read(len(BEGINS)) != BEGINS:
            raise InputError(file, "", "is no recording of Rerun; run its scenario or command again")
    return file


def check_whole(file: Path) -> None:
    """Refuse a recording that the viewer would show half of, or nothing.

    Raises:
        InputError: When it has no end, or cannot be decoded.
    """
    with file.open("rb") as opened:
        opened.seek(max(0, file.stat().st_size - LAST))
        ended = ENDS in opened.read(LAST)
    command = [program(), "rrd", "verify", str(file)]
    if not ended or VERIFIED not in subprocess.run(command, check=False, capture_output=True).stderr:
        raise InputError(file, "", "is no whole recording of Rerun; run its scenario or command again")


def has_display() -> bool:
    """Whether a window can be opened."""
    return sys.platform != "linux" or bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def view(file: Path) -> None:
    """Open a recording in the Rerun viewer, and wait until it is closed.

    Raises:
        BenchError: When the viewer fails.
    """
    command = [program(), str(file), "--port", "auto", "--bind", HERE]
    with child(command, os.environ) as process:
        code = process.wait()
    if code != 0:
        raise BenchError(f"the Rerun viewer ended with exit code {code}")


def program() -> str:
    """The viewer beside this interpreter: as a module of Python it would lose its exit codes."""
    found = Path(sys.executable).with_name("rerun")
    if not found.exists():
        raise BenchError(f"no program rerun beside {sys.executable}: install rerun-sdk there")
    return str(found)


def free_port() -> int:
    """A port of this machine that nothing listens on."""
    with socket.socket() as free:
        free.bind((HERE, 0))
        return int(free.getsockname()[1])


@contextmanager
def started(flags: Sequence[str], settings: Mapping[str, str]) -> Iterator[subprocess.Popen[bytes]]:
    """The viewer inside of the block, without traces and without sending usage data."""
    with temporary_folder() as home:
        kept = ("HOME", "XDG_RUNTIME_DIR", "XDG_DATA_HOME", "XDG_CONFIG_HOME", "XDG_CACHE_HOME", "TMPDIR")
        quiet = {"CI": "1", "NO_COLOR": "1"}  # CI: the viewer sends no usage data
        environment = {**os.environ, **dict.fromkeys(kept, str(home)), **quiet, **settings}
        command, silent = [program(), *flags, "--bind", HERE], subprocess.DEVNULL
        with child(command, environment, out=silent, err=silent) as process:
            yield process


def wait(look: Callable[[], T | None], seconds: float, complaint: str) -> T:
    """The first answer that is true.

    Raises:
        BenchError: The complaint, when there is none in time.
    """
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        answer = look()
        if answer:
            return answer
        time.sleep(LOOK_EVERY)
    raise BenchError(complaint)


def check_runs(process: subprocess.Popen[bytes]) -> None:
    """Refuse a viewer that has ended by itself."""
    if process.poll() is not None:
        raise BenchError(f"the viewer ended with exit code {process.returncode} before it showed anything")


def web_viewer() -> dict[str, bytes]:
    """Its files by name, the page as the empty one.

    Raises:
        BenchError: When the program fails.
    """
    port = free_port()
    flags = [NOTHING, "--serve-web", "--web-viewer-port", str(port), "--port", "auto"]
    with started(flags, {}) as process:

        def asked() -> dict[str, bytes] | None:
            check_runs(process)
            try:
                return {name: _get(port, name) for name in FILES}
            except OSError:  # it is not listening yet
                return None

        return wait(asked, START, f"the web viewer did not answer in {START:g} s")


def opener(recording: str, viewer: str) -> bytes:
    """A page that opens a recording in the web viewer, which asks for whole addresses."""
    whole = f"new URL({json.dumps(recording)}, location.href).href"
    to = f"{json.dumps(viewer)} + '?url=' + encodeURIComponent({whole})"
    head = '<!doctype html><meta charset="utf-8"><title>Recording</title>'
    return f"{head}<script>location.replace({to})</script>".encode()


def _get(port: int, name: str) -> bytes:
    connection = http.client.HTTPConnection(HERE, port, timeout=START)
    try:
        connection.request("GET", f"/{name}")
        answer = connection.getresponse()
        content = answer.read()
        if answer.status != http.HTTPStatus.OK:
            raise OSError(f"{name}: {answer.status}")
        return content
    finally:
        connection.close()
