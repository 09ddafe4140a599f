"""Every picture and film of README.md and docs, by today's code: `make pictures`.

python tools/pictures.py [PICTURE ...]

Pictures of commands are of runs that this script makes, in runs/pictures. Those of studies are of full runs,
which it does not make: where runs/full lacks one, the picture stays, and the command for it is printed. Every
picture holds its command and its numbers (`stamps`). Needs Mesa's software Vulkan (Debian:
mesa-vulkan-drivers).
"""

import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import opener
import pages
import shot
import typer
from PIL import Image
from read_reports import read_report
from stamps import Stamp, read_stamp, stamp

from testbench.errors import BenchError
from testbench.runs import command

ROOT = Path(__file__).resolve().parents[1]
DOCS, RUNS, FULL = ROOT / "docs", ROOT / "runs" / "pictures", ROOT / "runs" / "full"
COLOURS = 256
"""Of a picture: a viewer's screen has few, and the file shrinks to a third."""
TESTBENCH = "import sys; from testbench.cli import main; sys.exit(main())"  #: The program, by this Python.
WIDE = 1000  #: Of a figure of a run in the docs [pixel].
COMMANDS = {
    "demo": "testbench demo --out runs/demo",
    "model": "testbench identify kr500_l480 runs/demo/dataset.csv --out runs/model",
    "predict": "testbench predict runs/model docs/tasks.csv --load 460 --out runs/predict --recording",
    "corrected_report": (
        "testbench compensate runs/model docs/program.csv --recording --out runs/corrected.csv"
    ),
    "six_dof_arm": "python scenarios/six_dof_arm.py --seed 1000 --seeds 1 --out runs/six_dof_arm",
    "checked": "testbench check kr500_l480 --out runs/checked",
    "seen": "testbench data check kr500_l480 runs/demo/dataset.csv --out runs/seen",
    "tracker": "python scenarios/gravity_calibration.py --seeds 20 --out runs/tracker",
    "camera": "python scenarios/gravity_calibration.py --seeds 20 --sigma-um 150 --out runs/camera",
    "compared": "testbench compare runs/tracker runs/camera --out runs/compared",
    "C": "testbench calibrate ur10 models/ur10/readings/series_C.csv --out runs/C",
}
"""What makes a run, by its folder in runs; each may read those before it."""


@dataclass(frozen=True)
class Picture:
    """A picture of a run."""

    run: str  #: Key of COMMANDS.
    tab: str | None = None  #: Of the recording, in front; None for the first.
    figure: str = ""  #: Figure of the run in place of its recording.
    page: str = ""  #: Page that holds the numbers of the run's answer, if one does.


FILM = "loading"  #: The film of `opener`.
PICTURES = {
    FILM: Picture("demo", page="README.md"),
    "calibration": Picture("demo", page="README.md"),
    "calibration_errors": Picture("demo", "Where it errs", page="README.md"),
    "eigenvalues": Picture("demo", figure="eigenvalues.png"),
    "residuals": Picture("demo", figure="residuals.png"),
    "compliance": Picture("demo", figure="compliance.png"),
    "identify": Picture("model", figure="identify.png"),
    "identify_model": Picture("model", figure="model.png"),
    "recording_identify": Picture("model"),
    "recording_predict": Picture("predict"),
    "recording_compensate": Picture("corrected_report"),
    "stiffness": Picture("corrected_report", figure="stiffness.png"),
    "calibrate_ur10": Picture("C", figure="calibration.png", page="docs/calibration.md"),
    "recording_six_dof_arm": Picture("six_dof_arm"),
    "arm": Picture("checked", figure="arm.png"),
    "data": Picture("seen", figure="data.png"),
    "compare": Picture("compared", figure="compare.png"),
}
"""By name of the file in docs; those of studies bear the study's name, in docs/studies."""

app = typer.Typer(add_completion=False)


@app.command()
def main(
    names: Annotated[list[str] | None, typer.Argument(help="Pictures, such as calibration; all.")] = None,
) -> None:
    """Draw pictures of the docs anew."""
    known = (*PICTURES, *pages.STUDIES, pages.BOARD.name)
    if wrong := [name for name in names or () if name not in known]:
        raise BenchError(f"no picture {wrong[0]!r}; pictures are {', '.join(known)}")
    wanted = names or known
    runs = {PICTURES[name].run for name in wanted if name in PICTURES}
    make(RUNS, [run for run in COMMANDS if run in needed(runs)])
    for name in wanted:
        if name == pages.BOARD.name:
            print(_drawn(pages.draw_leaderboard()), flush=True)
        else:
            print(draw(name) if name in PICTURES else _of_study(name), flush=True)


def needed(runs: set[str]) -> set[str]:
    """Runs of commands, and those that their commands read."""
    words = {run: set(COMMANDS[run].replace("/", " ").split()) for run in runs}
    more = {other for run in runs for other in COMMANDS if other in words[run]}
    return runs if more <= runs else needed(runs | more)


Done = subprocess.CompletedProcess[str]


def as_process(program: str, *words: str) -> Done:
    """Run python or testbench as a process of this Python."""
    words = words if program == "python" else ("-c", TESTBENCH, *words)
    return subprocess.run([sys.executable, *words], cwd=ROOT, capture_output=True, text=True, check=False)


def make(folder: Path, runs: Sequence[str], do: Callable[..., Done] = as_process) -> None:
    """Make runs of commands in a folder in place of runs.

    Args:
        folder: The folder.
        runs: Names of the runs.
        do: Runs a program, "python" or "testbench", with its arguments.

    Raises:
        BenchError: When a command fails.
    """
    for run in runs:
        words = [str(folder / w[5:]) if w.startswith("runs/") else w for w in COMMANDS[run].split()]
        print(COMMANDS[run], flush=True)
        done = do(*words)
        if done.returncode:
            raise BenchError(f"{COMMANDS[run]}: {done.stderr.strip()}")


def draw(name: str) -> str:
    """Draw a picture whose run is there; what was done, for people."""
    own = PICTURES[name]
    folder, picture = RUNS / own.run, DOCS / f"{name}{'.gif' if name == FILM else '.png'}"
    if name == FILM:
        opener.draw(picture)
    elif own.figure:
        with Image.open(folder / own.figure) as figure:
            height = round(figure.height * WIDE / figure.width)
            shrink(figure.convert("RGB").resize((WIDE, height), Image.Resampling.LANCZOS), picture)
    else:
        with tempfile.TemporaryDirectory() as made:
            shot.shot(folder, Path(made) / "shot.png", shot.Sight(tab=own.tab))
            with Image.open(Path(made) / "shot.png") as screen:
                shrink(screen.convert("RGB"), picture)
    stamp(picture, Stamp(COMMANDS[own.run], read_report(folder / "report.json").headline))
    return _drawn(picture)


def _of_study(name: str) -> str:
    """Draw the picture of a study whose full run is there, or say which command makes that."""
    picture = pages.PAGES / f"{name}.png"
    if not (FULL / name / "report.json").is_file():
        run = f"python scenarios/{name}.py --out runs/{name}"
        asked = read_stamp(picture).command if picture.is_file() else run
        needs = asked.replace(f"runs/{name}", f"runs/full/{name}")
        return f"{picture.relative_to(ROOT)}: left as it is; it needs {needs}"
    pages.draw(name, FULL / name)
    return _drawn(picture)


def _drawn(picture: Path) -> str:
    return f"{picture.relative_to(ROOT)}: {picture.stat().st_size // 1024} KiB"


def shrink(picture: Image.Image, png: Path) -> None:
    """Write as many colours as a screen needs."""
    octree = Image.Quantize.FASTOCTREE  # median cut turns rare colours, the markers, into others
    picture.quantize(COLOURS, octree, dither=Image.Dither.NONE).save(png, optimize=True)


if __name__ == "__main__":
    sys.exit(command.run(app))
