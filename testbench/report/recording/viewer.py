"""The newest recording of a run, and Rerun's own viewer that opens it, in a window or in a browser."""

import os
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

from testbench.errors import BenchError, InputError
from testbench.runs.whole import restore

HERE = "127.0.0.1"  #: The address of this machine that no other one reaches.
BEGINS = b"RRF2"  #: What a recording of Rerun begins with.
ENDS, LAST = b"RRF2FOOT", 32
"""What stands at the end of one that was closed, and among how many bytes there."""
VERIFIED = b"1 file verified"  #: What the viewer's program says of a sound one.
ANY_PORT = ["--port", "auto", "--web-viewer-port", "0"]
"""Free ports: a second viewer opens beside the first."""


def newest(folder: Path) -> Path:
    """Find the newest recording of a run's folder, or of the runs in a folder.

    A name such as --save=x is a file only by its absolute path: the viewer would take it for a flag.

    Returns:
        Its absolute path.

    Raises:
        BenchError: When there is none.
        InputError: When it is no recording.
    """
    if folder.is_file() and folder.suffix == ".rrd":
        paths = [folder]
    else:
        restore(folder)
        paths = [file for there in ("*.rrd", "*/*.rrd") for file in folder.glob(there)]
        paths = [file for file in paths if file.is_file()]  # a pipe of that name has no end
    if not paths:
        raise BenchError(f"no recording (*.rrd) in {folder}: a scenario writes one into its --out folder")
    file = max(paths, key=lambda file: file.stat().st_mtime).absolute()
    with file.open("rb") as opened:
        if opened.read(len(BEGINS)) != BEGINS:
            raise InputError(file, "", "is no recording of Rerun; run its scenario or command again")
    return file


def check_whole(file: Path) -> None:
    """Refuse a recording of which the viewer would show a half, or nothing.

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
    """Tell whether a window can be opened."""
    return sys.platform != "linux" or bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def view(file: Path, *, web: bool) -> None:
    """Open a recording in the Rerun viewer, and wait until it is closed.

    The viewer listens on this machine only, and sends no usage data: CI tells it so.

    Args:
        file: The recording, by its absolute path.
        web: In a browser; the viewer prints its address.

    Raises:
        BenchError: When the viewer fails.
    """
    command = [program(), str(file), "--bind", HERE, *ANY_PORT, *(["--web-viewer"] if web else [])]
    code = subprocess.run(command, check=False, env={**os.environ, "CI": "1"}).returncode
    if code != 0:
        raise BenchError(f"the Rerun viewer ended with exit code {code}")


def program() -> str:
    """Find the viewer itself: its script in Python starts it as a child, which a kill would not reach."""
    spec = find_spec("rerun_cli")
    folder = Path(spec.origin).parent if spec is not None and spec.origin else Path()
    paths = [path for path in (folder / "Rerun.app/Contents/MacOS/Rerun", folder / "rerun") if path.is_file()]
    if not paths:
        raise BenchError(f"no Rerun viewer beside {sys.executable}: install rerun-sdk there")
    return str(paths[0])
