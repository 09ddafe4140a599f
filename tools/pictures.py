"""The pictures of README.md and docs/recordings.md, from the recordings of run folders, without a screen.

python tools/pictures.py --runs runs --out docs

Needs Mesa's software Vulkan (Debian: mesa-vulkan-drivers). A run that is not there is left out and said so.
"""

import sys
import tempfile
from pathlib import Path
from typing import Annotated

import typer
from PIL import Image

from testbench.errors import BenchError
from testbench.shell import command
from testbench.views.recording import viewer

COLOURS = 256
"""Of a picture: a viewer's screen has few, and the file shrinks to a third."""

PICTURES = {
    "calibration": ("gravity_calibration", None, None, 0),
    "calibration_errors": ("gravity_calibration", "Errors", None, 0),
    "loading": ("gravity_calibration", "Loading", "load", 100),
    "recording_six_dof_arm": ("six_dof_arm", None, None, 0),
    "recording_single_link": ("single_link", None, None, 0),
    "recording_solver_comparison": ("solver_comparison", None, None, 0),
    "recording_loaded_stiffness": ("loaded_stiffness", None, None, 0),
    "recording_identifiability": ("identifiability", None, None, 0),
    "recording_pose_selection": ("pose_selection", None, None, 0),
    "recording_error_map": ("pose_selection", "Error map", None, 0),
    "recording_noise_sensitivity": ("noise_sensitivity", None, None, 0),
    "recording_model_error": ("model_error", None, None, 0),
    "recording_which_model": ("which_model", None, None, 0),
    "recording_regimes": ("regimes", None, None, 0),
    "recording_calibrate": ("calibrate", None, None, 0),
    "recording_wrong_inputs": ("wrong_inputs", None, None, 0),
    "recording_real_ur10": ("real_ur10", None, None, 0),
    "recording_compensation": ("compensation", None, None, 0),
}
"""By file: folder of the run, tab in front, timeline, place on it."""

STEP = 10
"""Of the load between two pictures of the loading [%]."""
SMALL, GIF_COLOURS = (960, 600), 128
REST, MOVE = 1500, 250
"""How long the first and last picture stand, and the others [ms]."""

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
        viewer.shot(folder, png, viewer.Sight(size, tab, timeline, at))
        shrink(png)
        made += 1
        print(f"{png}: {png.stat().st_size // 1024} KiB")
    calibration = runs / "gravity_calibration"
    if calibration.is_dir():
        moving(calibration, out / "loading.gif", size)
    if not made:
        raise BenchError(f"no run in {runs}")


def moving(folder: Path, gif: Path, size: str) -> None:
    """The loading from 0 to 100 %, step by step at one frame, and back."""
    with tempfile.TemporaryDirectory() as scratch:
        shots = []
        for load in range(0, 101, STEP):
            png = Path(scratch) / f"{load}.png"
            viewer.shot(folder, png, viewer.Sight(size, "Loading", "load", load))
            with Image.open(png) as picture:
                small = picture.convert("RGB").resize(SMALL, Image.Resampling.LANCZOS)
            octree = Image.Quantize.FASTOCTREE
            shots.append(small.quantize(GIF_COLOURS, octree, dither=Image.Dither.NONE))
    rests = [REST, *[MOVE] * (len(shots) - 2), REST]
    shots[0].save(gif, save_all=True, append_images=shots[1:], duration=rests, loop=0, optimize=True)


def shrink(png: Path) -> None:
    """Keep as many colours as a screen needs."""
    with Image.open(png) as picture:
        octree = Image.Quantize.FASTOCTREE  # median cut turns rare colours, the markers, into others
        few = picture.convert("RGB").quantize(COLOURS, octree, dither=Image.Dither.NONE)
    few.save(png, optimize=True)


if __name__ == "__main__":
    sys.exit(command.run(app))
