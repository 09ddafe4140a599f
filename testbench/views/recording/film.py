"""Pictures one after the other as a GIF, or as an MP4 where ffmpeg is."""

import io
import os
import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path

from PIL import Image

from testbench.child import child
from testbench.errors import BenchError
from testbench.output.scratch import temporary_folder

LARGEST = 1_000_000  #: Of a GIF [byte]: larger ones do not play at once on a page.
COLOURS = (128, 64, 32)  #: Fewer and fewer, before the picture shrinks.
SHRINK, NARROWEST = 0.8, 200
"""How much it then shrinks at a time, and where that ends [pixel]."""
REST, MOVING, LONGEST = 1500, 4000, 500
"""How long the first and last picture stand, the others together, and one of these at most [ms]."""


def write_film(path: Path, suffix: str, pictures: Sequence[bytes]) -> None:
    """Write pictures as a film that rests at both ends.

    Args:
        path: The file to write, whatever its name.
        suffix: .gif or .mp4.
        pictures: PNGs of one size.

    Raises:
        BenchError: When a GIF does not get small, or there is no ffmpeg.
    """
    write = _write_mp4 if suffix == ".mp4" else _write_gif
    write(path, pictures, min(LONGEST, MOVING // max(1, len(pictures) - 2)))


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
