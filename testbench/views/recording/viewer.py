"""Recordings on a screen, and as pictures where there is none: the viewer as a program of its own."""

import os
import re
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rerun.experimental import ViewerClient

from testbench.errors import BenchError
from testbench.output.scratch import whole_file

SOFTWARE = "lvp_icd*.json"  #: Vulkan's description of lavapipe, Mesa's driver that needs no graphics card.
DRIVERS = (Path("/usr/share/vulkan/icd.d"), Path("/usr/local/share/vulkan/icd.d"), Path("/etc/vulkan/icd.d"))
START, LOAD, SETTLE = 30.0, 60.0, 3.0
"""Longest waits for the viewer and for the data, least wait for its messages to fade [s]."""
LOOK_EVERY = 0.25
LINKED = ("sh", "-c", 'exec 3<&0 </dev/null; (cat <&3 >/dev/null; kill -9 0) & exec "$@" 3<&-', "sh")
"""Runs a program that is killed, with all that it starts, when its standard input is closed."""
ALIKE = 3  #: Equal pictures in a row after which nothing moves any more.


def newest(folder: Path) -> Path:
    """The newest recording of a run's folder, or of the runs in a folder.

    Raises:
        BenchError: When there is none.
    """
    if folder.is_file() and folder.suffix == ".rrd":
        return folder
    found = [file for there in ("*.rrd", "*/*.rrd") for file in folder.glob(there)]
    if not found:
        raise BenchError(f"no recording (*.rrd) in {folder}: a scenario writes one into its --out folder")
    return max(found, key=lambda file: file.stat().st_mtime)


def view(folder: Path) -> None:
    """Open the newest recording of a folder in the Rerun viewer, and wait until it is closed.

    Raises:
        BenchError: When there is no recording, no display, or the viewer fails.
    """
    file = newest(folder)
    if sys.platform == "linux" and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise BenchError(f"no display to open {file} on; `testbench shot` renders it to a PNG without one")
    command = [_program(), str(file), "--port", "auto", "--bind", "127.0.0.1"]
    code = subprocess.run(command, check=False).returncode
    if code != 0:
        raise BenchError(f"the Rerun viewer ended with exit code {code}")


@dataclass(frozen=True)
class Sight:
    """What a picture shows."""

    size: str = "1600x1000"  #: Of the picture, WIDTHxHEIGHT [pixel].
    tab: str | None = None  #: Name of the tab in front; None for the first.
    timeline: str | None = None  #: Active timeline; None for the recording's own.
    at: int = 0  #: Place on it.


def shot(folder: Path, png: Path, sight: Sight) -> Path:
    """Render the newest recording of a folder without a screen, by Mesa's software Vulkan.

    Returns:
        The recording.

    Raises:
        BenchError: When there is no recording, no driver, no such tab, or the viewer fails.
    """
    if not re.fullmatch(r"[1-9]\d{2,3}x[1-9]\d{2,3}", sight.size):
        raise BenchError(f"--size: expected WIDTHxHEIGHT in pixels, such as 1600x1000, got {sight.size!r}")
    file, driver = newest(folder), _software_driver()
    with _headless(driver, sight.size) as client:
        client.open(str(file.resolve()))
        _wait(lambda: _loaded(client), LOAD, f"the viewer did not load {file} in {LOAD:g} s")
        if sight.tab is not None:
            _bring_forward(client, sight.tab)
        if sight.timeline is not None:
            _go(client, sight.timeline, sight.at)
        _settle(client)
        picture = client.take_screenshot()
    with whole_file(png) as part:
        part.write_bytes(picture)
    return file


def _program() -> str:
    """The viewer beside this interpreter: as a module of Python it would lose its exit codes."""
    program = Path(sys.executable).with_name("rerun")
    if not program.exists():
        raise BenchError(f"no program rerun beside {sys.executable}: install rerun-sdk there")
    return str(program)


def _software_driver() -> Path:
    found = [file for folder in DRIVERS for file in sorted(folder.glob(SOFTWARE))]
    if not found:
        needed = "install the Debian package mesa-vulkan-drivers"
        raise BenchError(f"no software Vulkan (lavapipe) to render with: {needed}")
    return found[0]


@contextmanager
def _headless(driver: Path, size: str) -> Iterator[ViewerClient]:
    """A viewer without a window and without traces, ended with the block."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    with tempfile.TemporaryDirectory(prefix="testbench-shot-") as home:
        state = dict.fromkeys(
            ("HOME", "XDG_RUNTIME_DIR", "XDG_DATA_HOME", "XDG_CONFIG_HOME", "XDG_CACHE_HOME"), home
        )
        vulkan = {"VK_DRIVER_FILES": str(driver), "VK_ICD_FILENAMES": str(driver), "WGPU_BACKEND": "vulkan"}
        quiet = {"CI": "1", "NO_COLOR": "1"}  # CI: the viewer sends no usage data
        flags = ["--headless", "--hide-welcome-screen", "--window-size", size]
        process = subprocess.Popen(
            [*LINKED, _program(), *flags, "--bind", "127.0.0.1", "--port", str(port)],
            env={**os.environ, **state, **vulkan, **quiet},
            stdin=subprocess.PIPE,  # closed when this process ends, however
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,  # the program starts the viewer as a child, and both must end
        )
        try:
            url = f"rerun+http://127.0.0.1:{port}/proxy"
            yield _wait(lambda: _connected(process, url), START, f"the viewer did not answer in {START:g} s")
        finally:
            with suppress(ProcessLookupError):  # it may have ended by itself
                os.killpg(process.pid, signal.SIGKILL)
            process.communicate()


def _connected(process: subprocess.Popen[bytes], url: str) -> ViewerClient | None:
    if process.poll() is not None:
        raise BenchError(f"the viewer ended with exit code {process.returncode} before it drew anything")
    try:
        client = ViewerClient.connect(url)
        client.get_state()
    except Exception:  # of several kinds while it is not listening yet
        return None
    return client


def _loaded(client: ViewerClient) -> bool:
    state = client.get_state()
    return bool(not state.loading and state.active_recording and state.views)


def _wait(look: Callable[[], Any], seconds: float, complaint: str) -> Any:
    """The first answer that is true."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        answer = look()
        if answer:
            return answer
        time.sleep(LOOK_EVERY)
    raise BenchError(complaint)


def _settle(client: ViewerClient) -> None:
    """Wait until nothing moves: data come in pieces, and messages of the start fade."""
    time.sleep(SETTLE)
    pictures: list[bytes] = []

    def still() -> bool:
        pictures.append(client.take_screenshot(max_size=400))
        return len(pictures) >= ALIKE and len(set(pictures[-ALIKE:])) == 1

    _wait(still, LOAD, f"the picture did not come to rest in {LOAD:g} s")


def _go(client: ViewerClient, timeline: str, at: int) -> None:
    """Go to a place on a timeline."""
    state = client.get_state()
    known = {t.name: t for r in state.recordings if r.store_id == state.active_recording for t in r.timelines}
    if timeline not in known:
        raise BenchError(f"--timeline: no timeline {timeline!r}; timelines are {', '.join(known)}")
    start, end = known[timeline].start, known[timeline].end
    if start is None or end is None or not start <= at <= end:
        raise BenchError(f"--at: expected {start} to {end} on timeline {timeline!r}, got {at}")
    client.set_time(timeline, sequence=at, play_state="paused")


def _bring_forward(client: ViewerClient, tab: str) -> None:
    """Make a tab of the layout the active one."""
    blueprint = client.get_blueprint("recording").blueprint
    names = {path.strip("/"): _name(entity) for path, entity in blueprint.items()}
    known = []
    for entity in blueprint.values():
        container = entity.get("ContainerBlueprint", {})
        if container.get("container_kind") == "Tabs":
            for child in container["contents"]:
                known.append(names.get(child))
                if known[-1] == tab:
                    container["active_tab"] = child
    if tab not in known:
        raise BenchError(f"--tab: no tab {tab!r}; tabs are {', '.join(filter(None, known))}")
    client.set_blueprint(blueprint, "recording")


def _name(entity: dict[str, Any]) -> str | None:
    """Display name of a view or container."""
    parts = [part for part in entity.values() if isinstance(part, dict)]
    return next((part["display_name"] for part in parts if "display_name" in part), None)
