"""Recordings as pictures where there is no screen: still, or moving along a timeline."""

import io
import os
import re
import shutil
import subprocess
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image
from rerun.experimental import ViewerClient

from testbench.child import child
from testbench.errors import BenchError
from testbench.output.whole import temporary_folder, whole_file
from testbench.views.recording import headless
from testbench.views.recording.viewer import newest

STILL, MOVING = "1600x1000", "800x566"  #: Usual sizes; a film of the latter is 800 x 500.
FRAMES = 21  #: Most pictures of a film.
BARS = 66  #: Height of the viewer's own bar and of the tabs, which a film leaves out [pixel].
LARGEST = 1_000_000  #: Of a GIF [byte]: larger ones do not play at once on a page.
COLOURS = (128, 64, 32)  #: Fewer and fewer, before the picture shrinks.
SHRINK, NARROWEST = 0.8, 200
"""How much it then shrinks at a time, and where that ends [pixel]."""
REST, PLAYED, LONGEST = 1500, 4000, 500
"""How long the first and last picture stand, the others together, and one of these at most [ms]."""


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


def write_film(path: Path, suffix: str, pictures: Sequence[bytes]) -> None:
    """Write pictures as a film that rests at both ends.

    Raises:
        BenchError: When a GIF does not get small, or there is no ffmpeg.
    """
    write = _write_mp4 if suffix == ".mp4" else _write_gif
    write(path, pictures, min(LONGEST, PLAYED // max(1, len(pictures) - 2)))


def check_ffmpeg() -> str:
    """The program ffmpeg; a BenchError where there is none."""
    found = shutil.which("ffmpeg")
    if found is None:
        raise BenchError("--out: an .mp4 needs the program ffmpeg, which is not here; a .gif needs nothing")
    return found


def _write_gif(path: Path, pictures: Sequence[bytes], each: int) -> None:
    frames = [Image.open(io.BytesIO(picture)).convert("RGB") for picture in pictures]
    width, height = frames[0].size
    scale, colours = 1.0, list(COLOURS)
    while width * scale >= NARROWEST:
        size = round(width * scale), round(height * scale)
        data = _gif([frame.resize(size, Image.Resampling.LANCZOS) for frame in frames], colours[0], each)
        if len(data) <= LARGEST:
            path.write_bytes(data)
            return
        if colours[1:]:
            del colours[0]
        else:
            scale *= SHRINK
    raise BenchError(f"--out: the GIF stays above {LARGEST // 1000} kB; choose a smaller --size")


def _gif(frames: Sequence[Image.Image], colours: int, each: int) -> bytes:
    """Of one palette, from the last picture on: with several the colours would flicker."""
    octree = Image.Quantize.FASTOCTREE  # median cut turns rare colours, the markers, into others
    palette = frames[-1].quantize(colours, octree, dither=Image.Dither.NONE)
    first, *others = (frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames)
    rests = [REST, *[each] * (len(frames) - 2), REST][: len(frames)]
    data = io.BytesIO()
    first.save(
        data, "GIF", save_all=True, append_images=others, duration=rests, loop=0, optimize=True, disposal=1
    )
    return data.getvalue()


def _write_mp4(path: Path, pictures: Sequence[bytes], each: int) -> None:
    program, held = check_ffmpeg(), round(REST / each)
    played = [pictures[0]] * held + [*pictures] + [pictures[-1]] * held
    with temporary_folder() as folder:
        for k, picture in enumerate(played):
            (folder / f"{k:05}.png").write_bytes(picture)
        even = "crop=trunc(iw/2)*2:trunc(ih/2)*2"  # players take even sizes only
        made = ["-f", "mp4", "-pix_fmt", "yuv420p", "-vf", even, "-movflags", "+faststart"]
        read = ["-framerate", f"{1000 / each:.3f}", "-i", str(folder / "%05d.png")]
        command = [program, "-loglevel", "error", "-nostdin", "-y", *read, *made, str(path.absolute())]
        with child(command, os.environ, err=subprocess.PIPE) as process:
            error = process.stderr.read() if process.stderr else b""
            process.wait()
    if process.returncode != 0:
        said = error.decode(errors="replace").strip().splitlines() or ["it does not say why"]
        raise BenchError(f"ffmpeg ended with exit code {process.returncode}: {said[-1]}")
