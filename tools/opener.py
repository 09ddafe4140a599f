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
from matplotlib.patches import Rectangle
from shot import write_film

from testbench.arm.mjcf import GRAVITY
from testbench.cli.demo import Demo
from testbench.errors import Array
from testbench.model.laws import model_for
from testbench.model.vjm import chain, generalised_load, joint_law_rotations
from testbench.plant.shapes import BodyFrames, elastic_frames, origins
from testbench.report.colours import CHOICE, LEAST_SQUARES, LOAD, Colour, hexadecimal
from testbench.report.colours import JOINTS as BLUE
from testbench.report.run_figure import draw_arm, outlines
from testbench.report.scene import STEEL, on_tool
from testbench.runs import command
from testbench.runs.whole import whole_file
from testbench.studies.campaign import coverage as trial
from testbench.studies.campaigns import Result
from testbench.workflows.cell import Campaign, Cell, build_cell, settle_both
from testbench.workflows.models import DEFAULT, JOINTS

SHOWN: Mapping[str, tuple[str, Colour]] = {
    JOINTS: ("Joint stiffness only", BLUE),
    "MLS56": ("Least squares", LEAST_SQUARES),
    DEFAULT: ("testbench's default", CHOICE.colour),
}
"""Models by name: in words, and their colour."""
FRAMES, SIZE, DPI = 24, (8.0, 4.5), 100  #: Pictures of the film, and 800 by 450 pixels.
ENLARGED, OFF = 100.0, 1000.0  #: Magnification of the sag and of errors [1].
MM = 1e3
CORD = 0.2  #: Length of the weight's cord [m].

app = typer.Typer(add_completion=False)


@dataclass(frozen=True)
class Sag:
    """An arm in one place under a growing load, by the truth or by a model."""

    frames: BodyFrames  #: Its bodies, deflections magnified, a pose a load.
    hook: Array  #: Where the weight hangs on it, (loads, 2) [m].
    off: Array  #: From the true markers to its own, middle of them, not magnified, (loads, 2) [m].
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
    pictures = list(_pictures(true, mass, *_sags(true, campaign, found, mass)))
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


def _sags(
    cell: Cell, campaign: Campaign, found: Sequence[Result], mass: Array
) -> tuple[Array, Sag, Sequence[Sag]]:
    """The sides that the arm is seen from, (2, 3), the truth and every model."""
    at, n = usual(found, campaign), len(mass)
    q, point = (np.repeat(own[at : at + 1], n, axis=0) for own in (campaign.truth.q, campaign.truth.point))
    wrench = np.zeros((n, 6))
    wrench[:, 2] = -GRAVITY * mass
    before, after = settle_both(cell.plant, campaign.scenario.truth, q, wrench, point)
    moved = [after.theta - before.theta, *(_bent(cell, r, q, (wrench, point)) for r in found)]
    names = list(cell.arm.markers)
    rest = _points(cell, names, q, np.zeros_like(before.theta))
    aside = rest[0, :, :2][np.linalg.norm(rest[0, :, :2], axis=-1).argmax()]
    sides = np.array([[*(aside / np.linalg.norm(aside)), 0.0], [0.0, 0.0, 1.0]])
    bends = [_points(cell, names, q, theta) - rest for theta in moved]
    sags = []
    for theta, bend in zip(moved, bends, strict=True):
        frames = elastic_frames(cell.plant, q, ENLARGED * theta)
        off = bend - bends[0]
        error = MM * np.sqrt((off**2).sum(axis=-1).mean(axis=-1))
        sags.append(Sag(frames, on_tool(cell, frames, point) @ sides.T, off.mean(axis=1) @ sides.T, error))
    return sides, sags[0], sags[1:]


def _bent(cell: Cell, model: Result, q: Array, load: tuple[Array, Array]) -> Array:
    """Links and joints as a model bends them, its laws of the joints included, (loads, n_theta) [m, rad]."""
    vjm = model_for(cell.vjm, model.estimate.structure)
    return joint_law_rotations(vjm, (model.estimate.C_theta @ generalised_load(chain(vjm, q), *load)).T)


def _points(cell: Cell, names: Sequence[str], q: Array, theta: Array) -> Array:
    return origins(cell.room, names, elastic_frames(cell.plant, q, theta))


def _pictures(cell: Cell, mass: Array, sides: Array, truth: Sag, models: Sequence[Sag]) -> Iterator[bytes]:
    """A picture a load."""
    every = [polygon for k in (0, -1) for polygon in outlines(cell, truth.frames, k, sides)[0]]
    points = np.concatenate(every)
    low, high = points.min(axis=0) - np.array([0, 0.1]), points.max(axis=0)
    best = min(range(len(models)), key=lambda k: models[k].error_mm[-1])
    most = max(s.error_mm.max() for s in models)
    for k, kg in enumerate(mass.tolist()):
        figure = Figure(figsize=SIZE, dpi=DPI, facecolor="white")
        canvas = FigureCanvasAgg(figure)
        figure.text(0.5, 0.93, "Which model knows how the KR 500 sags?", size=19, weight="bold", ha="center")
        for own, (sag, (name, colour)) in enumerate(zip(models, SHOWN.values(), strict=True)):
            left = 0.02 + own * 0.325
            axes = figure.add_axes((left, 0.25, 0.31, 0.59), frameon=False)
            axes.set(xticks=[], yticks=[])
            axes.axhline(0, color="0.85", lw=1.5)
            draw_arm(axes, *outlines(cell, sag.frames, k, sides), colour)
            draw_arm(axes, *outlines(cell, truth.frames, k, sides))
            _weight(axes, truth.hook[k], kg)
            _arrow(axes, truth.hook[k], sag, k, hexadecimal(colour))
            axes.set(xlim=(low[0] - 0.15, high[0] + 0.35), ylim=(low[1], high[1] + 0.2), aspect="equal")
            figure.text(
                left + 0.155, 0.855, name, size=14, weight="bold", ha="center", color=hexadecimal(colour)
            )
            last = k == len(mass) - 1 and own == best
            said = f"{sag.error_mm[k]:.2f} mm off{': best' if last else ''}"
            _count(figure, left, sag.error_mm[k] / most, said, hexadecimal(colour))
        figure.text(
            0.5,
            0.02,
            f"Grey: the true arm in a place never measured. Sag x {ENLARGED:.0f}, errors x {OFF:.0f}.",
            size=10.5,
            ha="center",
            color="0.3",
        )
        data = io.BytesIO()
        canvas.print_png(data)  # type: ignore[no-untyped-call]
        yield data.getvalue()


def _weight(axes: Axes, hook: Array, kg: float) -> None:
    """A weight of steel on its cord, its mass written on it."""
    if kg <= 0:
        return
    radius, purple = float(np.cbrt(kg / (2 * np.pi * STEEL))), hexadecimal(LOAD)
    x, z = hook
    top = z - CORD
    axes.plot([x, x], [z, top], color=purple, lw=1.5, zorder=6)
    axes.add_patch(Rectangle((x - radius, top - 2 * radius), 2 * radius, 2 * radius, color=purple, zorder=6))
    words = f"{kg:.0f} kg"
    axes.text(
        x,
        top - 2 * radius - 0.05,
        words,
        size=11,
        weight="bold",
        color=purple,
        ha="center",
        va="top",
        zorder=7,
    )


def _arrow(axes: Axes, start: Array, sag: Sag, k: int, colour: str) -> None:
    """The model's error at the tool, magnified, with its size."""
    size = float(np.linalg.norm(sag.off[k]))
    if size <= 0:
        return
    way = OFF * sag.error_mm[k] / MM * sag.off[k] / size
    style = {"width": 0.035, "head_width": 0.13, "head_length": 0.11, "length_includes_head": True}
    axes.arrow(*start, *way, color=colour, zorder=8, **style)


def _count(figure: Figure, left: float, share: float, words: str, colour: str) -> None:
    """The error as a number and as a bar."""
    bar = figure.add_axes((left + 0.02, 0.105, 0.27, 0.028), frameon=False)
    bar.set(xlim=(0, 1), ylim=(-0.5, 0.5), xticks=[], yticks=[])
    bar.barh(0, 1, height=1, color="0.93")
    bar.barh(0, share, height=1, color=colour)
    figure.text(left + 0.155, 0.165, words, size=16, weight="bold", ha="center", color=colour)


if __name__ == "__main__":
    sys.exit(command.run(app))
