"""Recordings as pictures where there is no screen: still, or moving along a timeline."""

import io
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image
from rerun.experimental import ViewerClient

from testbench.errors import BenchError
from testbench.output.whole import whole_file
from testbench.views.recording import headless
from testbench.views.recording.film import check_ffmpeg, write_film
from testbench.views.recording.viewer import newest

STILL, MOVING = "1600x1000", "800x566"  #: Usual sizes; a film of the latter is 800 x 500.
FRAMES = 21  #: Most pictures of a film.
BARS = 66  #: Height of the viewer's own bar and of the tabs, which a film leaves out [pixel].


@dataclass(frozen=True)
class Sight:
    """What a picture shows."""

    size: str | None = None  #: Of the viewer's window, WIDTHxHEIGHT [pixel]; None for the usual one.
    tab: str | None = None  #: Name of the tab in front; None for the first.
    timeline: str | None = None  #: Active timeline; None for the recording's own.
    at: int | None = None  #: Place on it; None for where the recording opens, or the timeline begins.

    def __post_init__(self) -> None:
        """Refuse a size that is none."""
        if self.size is not None and not re.fullmatch(r"[1-9]\d{2,3}x[1-9]\d{2,3}", self.size):
            raise BenchError(f"--size: expected WIDTHxHEIGHT in pixels, such as {STILL}, got {self.size!r}")


def shot(folder: Path, png: Path, sight: Sight) -> Path:
    """Render the newest recording of a folder without a screen, by Mesa's software Vulkan.

    Returns:
        The recording.

    Raises:
        BenchError: When there is no recording, driver, tab, timeline or place, or the viewer fails.
    """
    file = newest(folder)
    with whole_file(png) as part, headless.opened(file, sight.size or STILL) as client:
        if sight.tab is not None:
            headless.bring_forward(client, sight.tab)
        if sight.timeline is not None or sight.at is not None:
            timeline, first, _ = headless.places(client, sight.timeline)
            headless.go(client, timeline, first if sight.at is None else sight.at)
        part.write_bytes(headless.settled(client))
    return file


def film(folder: Path, path: Path, sight: Sight) -> Path:
    """Render it along a timeline as a GIF, or as an MP4 if the path says so, from one point of view.

    Args:
        folder: Of a run, or a recording.
        path: The GIF or MP4.
        sight: What it shows, at all places.

    Returns:
        The recording.

    Raises:
        BenchError: As `shot`; when there is no ffmpeg for an MP4, or a GIF stays too large.
    """
    file = newest(folder)
    if path.suffix == ".mp4":
        check_ffmpeg()
    with whole_file(path) as part:
        with headless.opened(file, sight.size or MOVING) as client:
            pictures = list(_frames(client, sight))
        write_film(part, path.suffix, pictures)
    return file


def _frames(client: ViewerClient, sight: Sight) -> Iterator[bytes]:
    """A picture a place, the viewer's own bars left out."""
    if sight.tab is not None:
        headless.bring_forward(client, sight.tab)
    headless.hide_bars(client)
    timeline, first, last = headless.places(client, sight.timeline)
    headless.go(client, timeline, first)
    headless.settled(client)
    for at in np.unique(np.rint(np.linspace(first, last, FRAMES)).astype(int)):
        headless.go(client, timeline, int(at))
        with Image.open(io.BytesIO(headless.still(client))) as picture:
            cut = io.BytesIO()
            picture.crop((0, BARS, *picture.size)).save(cut, "PNG")
        yield cut.getvalue()
