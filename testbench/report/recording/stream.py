"""One file per run: strict, closed in any case, written only when it is whole; and what draws in it."""

import contextlib
import hashlib
import os
import re
import subprocess
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from rerun.components import MarkerShape

from testbench.errors import Array, BenchError, InputError
from testbench.report.colours import GREY, Colour, Look
from testbench.runs.manifest import versions
from testbench.runs.whole import restore

# --- One file per run: strict, closed in any case, written only when it is whole; and what draws in it ------

rr.set_strict_mode(True)  # otherwise a wrong argument only warns, and the data are lost

SCRUB = 10.0  #: How long the timeline that a reader lands on is played [s].
MARKDOWN = "text/markdown"
MANY = 60  #: Rows beyond which dots of a plot are small, and lines join those of the first model alone.
SHAPES = (
    MarkerShape.Circle,
    MarkerShape.Square,
    MarkerShape.Diamond,
    MarkerShape.Up,
    MarkerShape.Down,
    MarkerShape.Plus,
)
"""One a shade of a family; with a prior a cross."""


@dataclass(frozen=True)
class RecordingHeader:
    """What identifies a recording."""

    scenario: str  #: Name of the scenario.
    parameters: str  #: The scenario as JSON.
    seed: int  #: Root of what is drawn.


@dataclass(frozen=True)
class Pen:
    """A recording that is being written, and the times of the rows that go into it."""

    stream: rr.RecordingStream
    times: tuple[rr.TimeColumn, ...] = ()

    def on(self, *times: rr.TimeColumn) -> "Pen":
        """The same on other timelines."""
        return replace(self, times=times)

    def still(self, path: str, *what: rr.AsComponents) -> None:
        """What does not change, or the looks of what does."""
        self.stream.log(path, *what, static=True)

    def documents(self, documents: Mapping[str, str]) -> None:
        """Markdown that does not change, by path."""
        for path, text in documents.items():
            self.still(path, rr.TextDocument(text, media_type=MARKDOWN))

    def names(self, path: str, at: Array, texts: Sequence[str], colour: Colour) -> None:
        """Texts that stand still at places (n, 2) or (n, 3)."""
        points = rr.Points2D if np.shape(at)[1] == 2 else rr.Points3D
        self.still(path, points(at, labels=texts, colors=colour, radii=0.0, show_labels=True))

    def rows(self, path: str, columns: Iterable[rr.ComponentColumn]) -> None:
        """A row a time."""
        self.stream.send_columns(path, self.times, columns)

    def layout(self, *tabs: rrb.Container | rrb.View, timeline: str | None, places: int) -> None:
        """Embed the layout: tabs, the first in front, and the timeline that a reader lands on, if any.

        That many places on the timeline are played in SCRUB seconds.
        """
        fps = max(1.0, places / SCRUB)
        panel = rrb.TimePanel(
            timeline=timeline, state="collapsed" if timeline else "hidden", play_state="paused", fps=fps
        )
        self.stream.send_blueprint(
            rrb.Blueprint(rrb.Tabs(*tabs, active_tab=0), panel, auto_views=False, collapse_panels=True)
        )

    def texts(self, path: str, texts: Sequence[str]) -> None:
        """Markdown, one a time."""
        self.rows(path, rr.TextDocument.columns(text=texts, media_type=[MARKDOWN] * len(texts)))

    def line(self, path: str, name: str, look: Look | None, values: Array, *, lead: bool = False) -> None:
        """A line of a plot, a value a time, NaN for none; without a look it is thin and grey."""
        colour, width = (look.colour, 3.5 if lead else 2.0) if look else (GREY, 1.0)
        many = len(values) > MANY
        if lead or look is None or not many:
            self.still(path, rr.SeriesLines(colors=colour, widths=width, names=name))
        if look is not None:
            shape = MarkerShape.Cross if look.prior else SHAPES[look.place % len(SHAPES)]
            size = 2.5 if many else 4.0
            self.still(path, rr.SeriesPoints(colors=colour, markers=shape, names=name, marker_sizes=size))
        known = np.isfinite(values)
        self.rows(path, rr.Scalars.columns(scalars=values[known]).partition(known.astype(int)))


def snake(title: str) -> str:
    """A title as a path."""
    return re.sub(r"\W+", "_", title.lower()).strip("_")


def text_view(origin: str, name: str) -> rrb.TextDocumentView:
    """The view of a document."""
    return rrb.TextDocumentView(origin=origin, name=name)


@contextlib.contextmanager
def recording(path: Path, header: RecordingHeader, words: Sequence[str] = ()) -> Iterator[Pen]:
    """A stream in memory, closed in any case; without an error it is written to `path`, whole.

    A stream into a file would only print that the disk is full, and leave half of it.

    Args:
        path: The .rrd file.
        header: What identifies it.
        words: What else tells it from recordings of another layout: the viewer keeps one an application id.
    """
    about = f"{header.scenario} {header.parameters} {header.seed}"
    application, digest = (
        hashlib.sha256(own.encode()).hexdigest()[:16] for own in ("\0".join([about, *words]), about)
    )
    # The stream's own properties hold the time of writing, and its chunks end by the clock: with either
    # equal seeds would differ.
    batches = rr.ChunkBatcherConfig.NEVER()
    stream = rr.RecordingStream(
        f"testbench_{application}", recording_id=digest, send_properties=False, batcher_config=batches
    )
    try:
        stream.set_log_time_enabled(False)
        stream.set_log_tick_enabled(False)
        memory = stream.memory_recording()
        _write_properties(stream, header)
        yield Pen(stream)
        path.write_bytes(memory.drain_as_bytes())
    finally:
        stream.disconnect()


def _write_properties(stream: rr.RecordingStream, header: RecordingHeader) -> None:
    stream.send_recording_name(f"{header.scenario}, seed {header.seed}")
    stream.send_property("study", rr.AnyValues(**vars(header)))
    stream.send_property("versions", rr.AnyValues(drop_untyped_nones=True, **versions()))


# --- The newest recording of a run, and Rerun's own viewer that opens it, in a window or in a browser -------

HERE = "127.0.0.1"  #: The address of this machine that no other one reaches.
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
    """
    if folder.is_file() and folder.suffix == ".rrd":
        paths = [folder]
    else:
        restore(folder)
        paths = [file for there in ("*.rrd", "*/*.rrd") for file in folder.glob(there)]
        paths = [file for file in paths if file.is_file()]  # a pipe of that name has no end
    if not paths:
        raise BenchError(
            f"no recording (*.rrd) in {folder}: expected the --out folder of a command or study; "
            "predict and compensate leave one with --recording"
        )
    return max(paths, key=lambda file: file.stat().st_mtime).absolute()


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
        raise InputError(file, "", "is not a complete Rerun recording; run the study or the command again")


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
