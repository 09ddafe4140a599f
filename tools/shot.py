"""A recording as a picture where there is no screen: still, or moving along a timeline.

    python tools/shot.py RUN --out picture.png [--tab Tables] [--timeline pose --at 3] [--size 1280x720]
    python tools/shot.py RUN --out poses.gif [--timeline pose]

Needs Mesa's software Vulkan (Debian: mesa-vulkan-drivers).
"""

import io
import re
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import headless
import numpy as np
import typer
from PIL import Image
from rerun.experimental import ViewerClient

from testbench.errors import BenchError
from testbench.report.recording.stream import newest
from testbench.runs import command

STILL, MOVING = "1600x1000", "800x566"  #: Usual sizes; a film of the latter is 800 x 500.
FRAMES = 21  #: Most pictures of a film.
BARS = 66  #: Height of the viewer's own bar and of the tabs, which a film leaves out [pixel].
LARGEST = 1_000_000  #: Of a GIF [byte]: larger ones do not play at once on a page.
COLOURS = (128, 64, 32)  #: Fewer and fewer, before the picture shrinks.
SHRINK, NARROWEST = 0.8, 200
"""How much it then shrinks at a time, and where that ends [pixel]."""
REST, PLAYED, LONGEST = 1500, 4000, 500
"""How long the first and last picture stand, the others together, and one of these at most [ms]."""

app = typer.Typer(add_completion=False)


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
    with headless.opened(file, sight.size or STILL) as client:
        if sight.tab is not None:
            headless.bring_forward(client, sight.tab)
        if sight.timeline is not None or sight.at is not None:
            timeline, first, _ = headless.places(client, sight.timeline)
            headless.go(client, timeline, first if sight.at is None else sight.at)
        png.write_bytes(headless.settled(client))
    return file


def film(folder: Path, gif: Path, sight: Sight) -> Path:
    """Render it along a timeline as a GIF, from one point of view.

    Returns:
        The recording.

    Raises:
        BenchError: As `shot`; when the GIF stays too large.
    """
    file = newest(folder)
    with headless.opened(file, sight.size or MOVING) as client:
        pictures = list(_frames(client, sight))
    write_film(gif, pictures, _resting(len(pictures)))
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


def _resting(pictures: int) -> list[int]:
    """How long each picture stands in a film that rests at both ends [ms]."""
    each = min(LONGEST, PLAYED // max(1, pictures - 2))
    return [REST, *[each] * (pictures - 2), REST][:pictures]


def write_film(path: Path, pictures: Sequence[bytes], durations: Sequence[int]) -> None:
    """Write pictures as a GIF that plays again and again.

    Args:
        path: The GIF.
        pictures: PNGs of one size.
        durations: How long each of them stands [ms].

    Raises:
        BenchError: When it does not get small.
    """
    frames = [Image.open(io.BytesIO(picture)).convert("RGB") for picture in pictures]
    width, height = frames[0].size
    scale, colours = 1.0, list(COLOURS)
    while width * scale >= NARROWEST:
        size = round(width * scale), round(height * scale)
        data = _gif([frame.resize(size, Image.Resampling.LANCZOS) for frame in frames], colours[0], durations)
        if len(data) <= LARGEST:
            path.write_bytes(data)
            return
        if colours[1:]:
            del colours[0]
        else:
            scale *= SHRINK
    raise BenchError(f"--out: the GIF stays above {LARGEST // 1000} kB; choose a smaller --size")


def _gif(frames: Sequence[Image.Image], colours: int, durations: Sequence[int]) -> bytes:
    """Of one palette, from the last picture on: with several the colours would flicker."""
    octree = Image.Quantize.FASTOCTREE  # median cut turns rare colours, the markers, into others
    palette = frames[-1].quantize(colours, octree, dither=Image.Dither.NONE)
    first, *others = (frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames)
    data = io.BytesIO()
    more = {"append_images": others, "duration": list(durations)}
    first.save(data, "GIF", save_all=True, **more, loop=0, optimize=True, disposal=1)
    return data.getvalue()


@app.command()
def main(
    folder: Annotated[Path, typer.Argument(help="Folder of a run, or one recording.")],
    out: Annotated[Path, typer.Option(help="Picture to write, .png or .gif.")] = Path("recording.png"),
    tab: Annotated[str | None, typer.Option(help="Tab in front, such as Tables.")] = None,
    timeline: Annotated[str | None, typer.Option(help="Active timeline, such as pose.")] = None,
    at: Annotated[int | None, typer.Option(min=0, help="Place on the timeline; default: the first.")] = None,
    size: Annotated[str | None, typer.Option(help="WIDTHxHEIGHT of the viewer in pixels.")] = None,
) -> None:
    """Render the newest recording of a run."""
    if out.suffix not in (".png", ".gif"):
        raise BenchError(f"--out: expected a name that ends with .png or .gif, got {out}")
    render = film if out.suffix == ".gif" else shot
    print(f"{out}: {render(folder, out, Sight(size, tab, timeline, at))}")


if __name__ == "__main__":
    sys.exit(command.run(app))
