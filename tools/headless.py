"""A viewer without a window, driven from here: recordings opened, tabs and times chosen, pictures taken."""

import os
import socket
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

from rerun.experimental import Recording, ViewerClient

from testbench.errors import BenchError, InputError
from testbench.report.recording.stream import HERE, program

T = TypeVar("T")

SOFTWARE = "lvp_icd*.json"  #: Vulkan's description of lavapipe, Mesa's driver that needs no graphics card.
DRIVERS = (Path("/usr/share/vulkan/icd.d"), Path("/usr/local/share/vulkan/icd.d"), Path("/etc/vulkan/icd.d"))
START, LOAD, SETTLE = 30.0, 60.0, 3.0
"""Longest waits for the viewer and for the data, least wait for its messages to fade [s]."""
COMPLAINT = 2.0  #: Longest wait for the reason of what the viewer refuses, which comes after the refusal [s].
LOOK_EVERY = 0.25  #: Between two looks at a program that is waited for [s].
LATE = "deadline"  #: What a client says whose viewer took longer to answer than it gives it, 15 s.
ALIKE = 3  #: Equal pictures in a row after which nothing moves any more.


class PatientClient(ViewerClient):
    """A client that asks a busy viewer again, for as long as data may take to load."""

    def _viewer_control(self, operation: str, request: dict[str, Any]) -> dict[str, Any]:
        end = time.monotonic() + LOAD
        while True:
            try:
                return super()._viewer_control(operation, request)
            except (ConnectionError, TimeoutError) as err:
                if LATE not in str(err).lower() or time.monotonic() > end:
                    raise


def free_port() -> int:
    """Find a port of this machine that nothing listens on."""
    with socket.socket() as free:
        free.bind((HERE, 0))
        return int(free.getsockname()[1])


@contextmanager
def started(flags: Sequence[str], settings: Mapping[str, str]) -> Iterator[subprocess.Popen[bytes]]:
    """Run the viewer inside of the block, without traces and without sending usage data."""
    with tempfile.TemporaryDirectory() as home:
        kept = ("HOME", "XDG_RUNTIME_DIR", "XDG_DATA_HOME", "XDG_CONFIG_HOME", "XDG_CACHE_HOME", "TMPDIR")
        quiet = {"CI": "1", "NO_COLOR": "1"}  # CI: the viewer sends no usage data
        environment = {**os.environ, **dict.fromkeys(kept, home), **quiet, **settings}
        command, silent = [program(), *flags, "--bind", HERE], subprocess.DEVNULL
        process = subprocess.Popen(command, env=environment, stdin=silent, stdout=silent, stderr=silent)
        try:
            yield process
        finally:
            process.kill()
            process.wait()


def wait(look: Callable[[], T | None], seconds: float, complaint: str) -> T:
    """Return the first answer that is true.

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


@contextmanager
def opened(file: Path, size: str) -> Iterator[ViewerClient]:
    """A viewer that shows a recording, ended with the block; as `windowless` and `show`."""
    with windowless(size) as client:
        show(client, file)
        yield client


@contextmanager
def windowless(size: str) -> Iterator[ViewerClient]:
    """A viewer that shows nothing yet, ended with the block.

    Raises:
        BenchError: When there is no driver, or the viewer fails.
    """
    driver, port = str(software_driver()), free_port()
    vulkan = {"VK_DRIVER_FILES": driver, "VK_ICD_FILENAMES": driver, "WGPU_BACKEND": "vulkan"}
    flags = ["--headless", "--hide-welcome-screen", "--window-size", size, "--port", str(port)]
    with started(flags, vulkan) as process:

        def connected() -> ViewerClient | None:
            check_runs(process)
            return _connected(f"rerun+http://{HERE}:{port}/proxy")

        try:
            yield wait(connected, START, f"the viewer did not answer in {START:g} s")
        except (ConnectionError, TimeoutError, RuntimeError) as err:  # of its client, such as a deadline
            if isinstance(err, BenchError):
                raise
            said = " ".join(str(err).split()) or type(err).__name__
            raise BenchError(f"the viewer did not answer in time: {said}; is the machine busy?") from err


def show(client: ViewerClient, file: Path) -> None:
    """Open a recording and wait until it is there.

    Raises:
        BenchError: When that takes too long.
        InputError: When the recording cannot be read.
    """
    found = client.open(str(file.absolute()))
    if not found.store_ids and not found.loading:
        raise InputError(file, "", f"cannot be read: {_complaint(client, file.absolute())}")
    wait(lambda: _loaded(client), LOAD, f"the viewer did not load {file} in {LOAD:g} s")


def software_driver() -> Path:
    """Vulkan's description of lavapipe; a BenchError where it is missing."""
    found = [file for folder in DRIVERS for file in sorted(folder.glob(SOFTWARE))]
    if not found:
        needed = "install the Debian package mesa-vulkan-drivers"
        raise BenchError(f"no software Vulkan (lavapipe) to render with: {needed}")
    return found[0]


def _connected(url: str) -> ViewerClient | None:
    try:
        client = PatientClient.connect(url)
        client.get_state()
    except Exception:  # of several kinds while it is not listening yet
        return None
    return client


def _complaint(client: ViewerClient, file: Path) -> str:
    """What the viewer said last: its reason stands behind the name of the file."""
    end = time.monotonic() + COMPLAINT
    while not (said := [own.message for own in client.get_logs() if own.level == "ERROR"]):
        if time.monotonic() > end:
            return "the viewer says nothing"
        time.sleep(0.05)
    return said[-1].split(f"{file}: ")[-1].splitlines()[0]


def _loaded(client: ViewerClient) -> bool:
    state = client.get_state()
    return bool(not state.loading and state.active_recording and state.views)


def settled(client: ViewerClient) -> bytes:
    """The picture once data, which come in pieces, are there and messages of the start have faded."""
    time.sleep(SETTLE)
    return still(client, ALIKE)


def still(client: ViewerClient, alike: int = 2) -> bytes:
    """The picture, a PNG, once nothing moves: the last of so many that are equal."""
    pictures: list[bytes] = []

    def rests() -> bool:
        pictures.append(client.take_screenshot())
        return len(pictures) >= alike and len(set(pictures[-alike:])) == 1

    wait(rests, LOAD, f"the picture did not come to rest in {LOAD:g} s")
    return pictures[-1]


def places(client: ViewerClient, timeline: str | None) -> tuple[str, int, int]:
    """A timeline by name, or the active one: its name, first and last place.

    Raises:
        BenchError: When there is no such timeline, or nothing on it.
    """
    front = shown(client)
    name = front.current_timeline if timeline is None else timeline
    known = {t.name: (t.start, t.end) for t in front.timelines}
    if name not in known:
        raise BenchError(f"--timeline: no timeline {name!r}; timelines are {', '.join(known) or 'none'}")
    start, end = known[name]
    if start is None or end is None:
        raise BenchError(f"--timeline: nothing is on timeline {name!r}")
    return name, start, end


def shown(client: ViewerClient) -> Recording:
    """The recording in front."""
    state = client.get_state()
    return next(r for r in state.recordings if r.store_id == state.active_recording)


def go(client: ViewerClient, timeline: str, at: int) -> None:
    """Go to a place on a timeline.

    Raises:
        BenchError: When either is not there.
    """
    _, start, end = places(client, timeline)
    if not start <= at <= end:
        raise BenchError(f"--at: expected {start} to {end} on timeline {timeline!r}, got {at}")
    client.set_time(timeline, sequence=at, play_state="paused")


def bring_forward(client: ViewerClient, tab: str) -> None:
    """Make a tab of the layout the active one.

    Raises:
        BenchError: When there is no such tab.
    """
    blueprint = client.get_blueprint("recording").blueprint
    tabs = _tabs(blueprint)
    if tab not in tabs:
        raise BenchError(f"--tab: no tab {tab!r}; tabs are {', '.join(tabs)}")
    container, child = tabs[tab]
    container["active_tab"] = child
    client.set_blueprint(blueprint, "recording")


def hide_bars(client: ViewerClient) -> None:
    """Leave out the viewer's menu and its time panel."""
    blueprint = client.get_blueprint("recording").blueprint
    blueprint["/top_panel"] = {"PanelBlueprint": {"state": "Hidden"}}
    blueprint["/time_panel"]["TimePanelBlueprint"]["state"] = "Hidden"
    client.set_blueprint(blueprint, "recording")


def _tabs(blueprint: dict[str, Any]) -> dict[str, tuple[dict[str, Any], str]]:
    """By the name of a tab: the container that it is a tab of, and its path."""
    names = {path.strip("/"): _name(entity) for path, entity in blueprint.items()}
    containers = [entity.get("ContainerBlueprint", {}) for entity in blueprint.values()]
    tabbed = [found for found in containers if found.get("container_kind") == "Tabs"]
    return {names[path] or path: (found, path) for found in tabbed for path in _listed(found["contents"])}


def _listed(contents: str | list[str]) -> list[str]:
    """Of a container with one thing in it the viewer gives that."""
    return [contents] if isinstance(contents, str) else contents


def _name(entity: dict[str, Any]) -> str | None:
    """Display name of a view or container."""
    parts = [part for part in entity.values() if isinstance(part, dict)]
    return next((part["display_name"] for part in parts if "display_name" in part), None)
