"""The moving picture of README.md: three models beside the truth, under a growing load.

python tools/opener.py --out docs/loading.gif

Calibrates the arm of `testbench demo`, seed 1, and hangs the weight in a place that nobody measured: among
the half where the arm reaches furthest, the one where models err most nearly as they do over the workspace.
"""

import io
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from shot import write_film

from testbench.arm.mjcf import GRAVITY
from testbench.cli.demo import Demo
from testbench.errors import Array
from testbench.model.laws import model_for
from testbench.model.vjm import chain, generalised_load, joint_law_rotations
from testbench.plant.shapes import elastic_frames, origins
from testbench.report.colours import CHOICE, GREY, LEAST_SQUARES, LOAD, Colour, hexadecimal
from testbench.report.colours import JOINTS as BLUE
from testbench.runs import command
from testbench.runs.whole import whole_file
from testbench.studies.campaign import coverage as trial
from testbench.workflows.cell import Campaign, Cell, build_cell, settle_both
from testbench.workflows.evaluation import Result
from testbench.workflows.model_selection import DEFAULT
from testbench.workflows.models import JOINTS

SHOWN: Mapping[str, tuple[str, Colour]] = {
    JOINTS: ("Joint stiffness only", BLUE),
    "MLS56": ("Least squares", LEAST_SQUARES),
    DEFAULT: ("testbench's default", CHOICE.colour),
}
"""Models by name: in words, and their colour."""
FRAMES, SIZE, DPI = 24, (8.0, 4.5), 100  #: Pictures of the film, and 800 by 450 pixels.
ENLARGED = 200.0  #: Deflections [1].
MM = 1e3
TRUTH = "0.72"  #: Grey of the ghost.

app = typer.Typer(add_completion=False)


@dataclass(frozen=True)
class Sag:
    """An arm in one place under a growing load, by the truth or by a model."""

    bodies: Array  #: Origins of its bodies from the base on, deflections enlarged, (loads, n, 2) [m].
    markers: Array  #: The same of its markers, (loads, m, 2) [m].
    error_mm: Array  #: RMS over the markers, (loads,).


@app.command()
def main(
    out: Annotated[Path, typer.Option(help="The GIF, or the PNG with --still.")],
    still: Annotated[bool, typer.Option(help="Write the last picture as a PNG instead.")] = False,
) -> None:
    """Draw the film."""
    draw(out, still=still)
    print(f"{out}: {out.stat().st_size // 1024} KiB")


def draw(out: Path, *, still: bool = False) -> None:
    """Calibrate, and draw the film, or its last picture alone."""
    cell = build_cell(Demo().arm)
    asked = trial.settings(Demo(), quick=False, seeds=range(1, 2))
    true, campaign = trial.calibrate(cell, asked, 1)
    found = [r for name in SHOWN for r in trial.results(true, campaign) if r.model.name == name]
    mass = asked.scenario.mass * np.linspace(0, 1, FRAMES)
    pictures = list(_pictures(mass, *_sags(true, campaign, found, mass)))
    with whole_file(out) as part:
        if still:
            part.write_bytes(pictures[-1])
        else:
            write_film(part, pictures)


def usual(found: Sequence[Result], campaign: Campaign) -> int:
    """Of the half of places furthest out, that where errors are most like those over all places."""
    reach = np.linalg.norm(campaign.truth.before[:, 0, :2], axis=-1)
    off = np.max([np.abs(np.log(r.places / r.truth.rms)) for r in found], axis=0)
    return int(np.where(reach >= np.median(reach), off, np.inf).argmin())


def _sags(cell: Cell, campaign: Campaign, found: Sequence[Result], mass: Array) -> tuple[Sag, Sequence[Sag]]:
    """The truth and every model, as seen from the arm's broad side."""
    at, n = usual(found, campaign), len(mass)
    q, point = (np.repeat(own[at : at + 1], n, axis=0) for own in (campaign.truth.q, campaign.truth.point))
    wrench = np.zeros((n, 6))
    wrench[:, 2] = -GRAVITY * mass
    before, after = settle_both(cell.plant, campaign.scenario.truth, q, wrench, point)
    moved = [after.theta - before.theta, *(_bent(cell, r, q, (wrench, point)) for r in found)]
    names = [*(link.name for link in cell.arm.links), cell.arm.tool, *cell.arm.markers]
    rest = _points(cell, names, q, np.zeros_like(before.theta))
    aside = rest[0, :, :2][np.linalg.norm(rest[0, :, :2], axis=-1).argmax()]
    seen = np.array([[*(aside / np.linalg.norm(aside)), 0.0], [0.0, 0.0, 1.0]]).T
    bends = [_points(cell, names, q, theta) - rest for theta in moved]
    m = len(cell.arm.markers)
    sags = []
    for bend in bends:
        drawn = (rest + ENLARGED * bend) @ seen
        off = np.linalg.norm((bend - bends[0])[:, -m:], axis=-1)
        error = MM * np.sqrt((off**2).mean(axis=1))
        sags.append(Sag(drawn[:, :-m], drawn[:, -m:], error))
    return sags[0], sags[1:]


def _bent(cell: Cell, model: Result, q: Array, load: tuple[Array, Array]) -> Array:
    """Links and joints as a model bends them, its laws of the joints included, (loads, n_theta) [m, rad]."""
    vjm = model_for(cell.vjm, model.estimate.structure)
    return joint_law_rotations(vjm, (model.estimate.C_theta @ generalised_load(chain(vjm, q), *load)).T)


def _points(cell: Cell, names: Sequence[str], q: Array, theta: Array) -> Array:
    return origins(cell.room, names, elastic_frames(cell.plant, q, theta))


def _pictures(mass: Array, truth: Sag, models: Sequence[Sag]) -> Iterator[bytes]:
    """A picture a load."""
    every = np.concatenate([own.reshape(-1, 2) for s in (truth, *models) for own in (s.bodies, s.markers)])
    ends = np.array([np.minimum(every.min(axis=0), 0.0), every.max(axis=0)])
    best = min(range(len(models)), key=lambda k: models[k].error_mm[-1])
    most = max(s.error_mm.max() for s in models)
    for k, kg in enumerate(mass.tolist()):
        figure = Figure(figsize=SIZE, dpi=DPI, facecolor="white")
        canvas = FigureCanvasAgg(figure)
        figure.text(0.5, 0.935, "Which model knows how the robot sags?", size=19, weight="bold", ha="center")
        words = f"load {kg:.0f} kg"
        figure.text(0.5, 0.875, words, size=14, ha="center", color=hexadecimal(LOAD), weight="bold")
        for own, (sag, (name, colour)) in enumerate(zip(models, SHOWN.values(), strict=True)):
            left = 0.02 + own * 0.325
            axes = figure.add_axes((left, 0.27, 0.31, 0.53), frameon=False)
            _arm(axes, truth, sag, k, hexadecimal(colour))
            axes.set(xlim=ends[:, 0] + [-0.25, 0.35], ylim=ends[:, 1] + [-0.1, 0.25], aspect="equal")
            figure.text(
                left + 0.155, 0.815, name, size=14, weight="bold", ha="center", color=hexadecimal(colour)
            )
            last = k == len(mass) - 1 and own == best
            said = f"{sag.error_mm[k]:.2f} mm off{': best' if last else ''}"
            _count(figure, left, sag.error_mm[k] / most, said, hexadecimal(colour))
        figure.text(
            0.5,
            0.02,
            f"Grey: the true arm. Deflections enlarged {ENLARGED:.0f} times, in a place never measured.",
            size=10.5,
            ha="center",
            color="0.3",
        )
        data = io.BytesIO()
        canvas.print_png(data)  # type: ignore[no-untyped-call]
        yield data.getvalue()


def _arm(axes: Axes, truth: Sag, model: Sag, k: int, colour: str) -> None:
    """The truth as a ghost, the model before it, and the weight."""
    axes.set(xticks=[], yticks=[])
    axes.axhline(0, color="0.85", lw=1.5)
    axes.plot(*truth.bodies[k].T, color=TRUTH, lw=9, solid_capstyle="round", solid_joinstyle="round")
    axes.plot(*model.bodies[k].T, color=colour, lw=3, solid_capstyle="round", solid_joinstyle="round")
    axes.plot(*truth.markers[k].T, "o", color=hexadecimal(GREY), ms=8)
    axes.plot(*model.markers[k].T, "o", color=colour, ms=6, mec="white")
    if k:
        size = 0.5 * k / (FRAMES - 1)
        x, z = truth.bodies[k, -1]
        arrow = {
            "width": 0.06,
            "head_width": 0.2,
            "head_length": 0.15,
            "color": hexadecimal(LOAD),
            "zorder": 5,
        }
        axes.arrow(x, z, 0.0, -size, **arrow)


def _count(figure: Figure, left: float, share: float, words: str, colour: str) -> None:
    """The error as a number and as a bar."""
    bar = figure.add_axes((left + 0.02, 0.105, 0.27, 0.028), frameon=False)
    bar.set(xlim=(0, 1), ylim=(-0.5, 0.5), xticks=[], yticks=[])
    bar.barh(0, 1, height=1, color="0.93")
    bar.barh(0, share, height=1, color=colour)
    figure.text(left + 0.155, 0.165, words, size=16, weight="bold", ha="center", color=colour)


if __name__ == "__main__":
    sys.exit(command.run(app))
