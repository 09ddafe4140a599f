"""The pictures of README.md and docs/recordings.md, from the recordings of run folders, without a screen.

python tools/pictures.py --runs runs --out docs

Needs Mesa's software Vulkan (Debian: mesa-vulkan-drivers). A run that is not there is left out and said so.
"""

import sys
from pathlib import Path
from typing import Annotated

import opener
import shot
import typer
from PIL import Image

from testbench.errors import BenchError
from testbench.shell import command

COLOURS = 256
"""Of a picture: a viewer's screen has few, and the file shrinks to a third."""

PICTURES = {
    "calibration": ("gravity_calibration", None, None, None),
    "calibration_errors": ("gravity_calibration", "Where it errs", None, None),
    "recording_six_dof_arm": ("six_dof_arm", None, None, None),
    "recording_identify": ("identify", None, None, None),
    "recording_compensate": ("compensate", None, None, None),
    "recording_predict": ("predict", None, None, None),
}
"""By file: folder of the run, tab in front, timeline, place on it."""

app = typer.Typer(add_completion=False)


@app.command()
def main(
    runs: Annotated[Path, typer.Option(help="Folder with one folder a scenario.")] = Path("runs"),
    out: Annotated[Path, typer.Option(help="Folder of the pictures.")] = Path("docs"),
    size: Annotated[str, typer.Option(help="WIDTHxHEIGHT in pixels.")] = "1600x1000",
) -> None:
    """Render every picture whose run is there."""
    made = 0
    for name, (run, tab, timeline, at) in PICTURES.items():
        folder, png = runs / run, out / f"{name}.png"
        if not folder.is_dir():
            print(f"{png}: left out, no {folder}; make it with scenarios/{run}.py --out {folder}")
            continue
        shot.shot(folder, png, shot.Sight(size, tab, timeline, at))
        shrink(png)
        made += 1
        print(f"{png}: {png.stat().st_size // 1024} KiB")
    opener.draw(gif := out / "loading.gif")
    made += 1
    print(f"{gif}: {gif.stat().st_size // 1024} KiB")
    if not made:
        raise BenchError(f"no run in {runs}")


def shrink(png: Path) -> None:
    """Keep as many colours as a screen needs."""
    with Image.open(png) as picture:
        octree = Image.Quantize.FASTOCTREE  # median cut turns rare colours, the markers, into others
        few = picture.convert("RGB").quantize(COLOURS, octree, dither=Image.Dither.NONE)
    few.save(png, optimize=True)


if __name__ == "__main__":
    sys.exit(command.run(app))
