"""The moving picture of README.md: how far three models miss the tool of an arm under a growing load.

python tools/opener.py --out docs/loading.gif

Calibrates the arm of `testbench demo`, seed 1, and hangs the weight in a place that nobody measured: among
the half where the arm reaches furthest, the one where models err most nearly as they do over the workspace.
The film begins with the full load, so that whoever sees one picture only sees the answer.
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
from matplotlib.patches import Circle, Rectangle
from shot import write_film

from testbench.arm.mjcf import GRAVITY
from testbench.cli.demo import Demo
from testbench.errors import Array
from testbench.identify.estimate import Estimate, deflections_of_models
from testbench.model.laws import vjm_for_structure
from testbench.model.vjm import add_law_deflections, evaluate_chain, generalised_load
from testbench.plant.shapes import body_origins, elastic_frames
from testbench.report.colours import CHOICE, LEAST_SQUARES, LOAD, Colour, hexadecimal
from testbench.report.colours import JOINTS as BLUE
from testbench.report.run_figure import draw_arm, outlines
from testbench.report.scene import STEEL, on_tool
from testbench.runs import command
from testbench.runs.whole import whole_file
from testbench.studies.campaign import gravity_calibration as trial
from testbench.workflows.campaign import Campaign, settle_both
from testbench.workflows.cell import Cell, build_cell
from testbench.workflows.models import DEFAULT, JOINTS_ONLY

SHOWN: Mapping[str, tuple[str, Colour]] = {
    JOINTS_ONLY: ("Joints-only\nmodel", BLUE),
    "MLS56": ("Least\nsquares", LEAST_SQUARES),
    DEFAULT: ("testbench's\ndefault", CHOICE.colour),
}
"""Models by name: in words, and their colour."""
LOADS, SIZE, DPI = 24, (8.0, 4.5), 100  #: Loads from none to full, and 800 by 450 pixels.
HELD, EMPTY, EACH = 3000, 300, 120  #: How long full load, no load and each load between stand [ms].
LIFTED = 4  #: Steps of the load at once while the weight is taken off.
ENLARGED = 100.0  #: Magnification of the sag [1].
RING = 0.5  #: Between the rings of a target [mm].
WIDE = 1.08  #: Half the width of a target, over the largest error [1].
HEAD = 0.22  #: Longest head of an arrow [mm].
MM = 1e3
CORD = 0.2  #: Length of the weight's cord [m].
WORDS, GHOST, LINE = "0.3", (214, 214, 214), "0.85"  #: Greys of words, the unloaded arm, and lines.

app = typer.Typer(add_completion=False)


@dataclass(frozen=True)
class Sag:
    """The true arm in one place under a growing load."""

    shapes: Sequence[tuple[list[Array], Array]]  #: See `outlines`, its deflections magnified, one a load.
    hook: Array  #: Where the weight hangs on it, (loads, 2) [m].
    size_mm: Array  #: How far its markers move, RMS, not magnified, (loads,).


@dataclass(frozen=True)
class Miss:
    """A model's error there."""

    way: Array  #: From the true markers to its own, middle of them, of unit length, (loads, 2) [1].
    size_mm: Array  #: RMS over the markers, (loads,).


@app.command()
def main(
    out: Annotated[Path, typer.Option(help="The GIF, or the PNG with --still.")],
    still: Annotated[bool, typer.Option(help="Write the picture of full load as a PNG instead.")] = False,
) -> None:
    """Draw the film."""
    draw(out, still=still)
    print(f"{out}: {out.stat().st_size // 1024} KiB")


def draw(out: Path, *, still: bool = False) -> None:
    """Calibrate, and draw the film, or its picture of full load alone."""
    cell = build_cell(Demo().arm)
    asked = trial.settings(Demo(), quick=False, seeds=range(1, 2))
    true, campaign = trial.calibrate(cell, asked, 1)
    fits = trial.results(true, campaign)
    found = [fits[name][0] for name in SHOWN]
    mass = asked.scenario.mass * np.linspace(0, 1, LOADS)
    pictures = list(_pictures(mass, *_sags(true, campaign, found, mass)))
    with whole_file(out) as part:
        if still:
            part.write_bytes(pictures[-1])
        else:
            write_film(part, [pictures[k] for k in played()], [_stands(k) for k in played()])


def played() -> list[int]:
    """Loads in the film's order: full, the weight taken off, and grown again up to where the film begins."""
    full = LOADS - 1
    return [full, *range(full - LIFTED, 0, -LIFTED), *range(full)]


def _stands(load: int) -> int:
    """How long the picture of a load stands [ms]."""
    return {LOADS - 1: HELD, 0: EMPTY}.get(load, EACH)


def usual(cell: Cell, found: Sequence[Estimate], campaign: Campaign) -> int:
    """Of the half of places furthest out, that where errors are most like those over all places."""
    reach = np.linalg.norm(campaign.truth.before[:, 0, :2], axis=-1)
    errors = campaign.truth.deflection - deflections_of_models(cell.vjm, found, campaign.truth)
    square = np.square(errors).sum(axis=-1).mean(axis=-1)  # (models, places)
    off = np.max(np.abs(np.log(square / square.mean(axis=1, keepdims=True))), axis=0)
    return int(np.where(reach >= np.median(reach), off, np.inf).argmin())


def _sags(
    cell: Cell, campaign: Campaign, found: Sequence[Estimate], mass: Array
) -> tuple[Sag, Sequence[Miss]]:
    """The truth and every model, seen from the side."""
    at, n = usual(cell, found, campaign), len(mass)
    q, point = (np.repeat(own[at : at + 1], n, axis=0) for own in (campaign.truth.q, campaign.truth.point))
    wrench = np.zeros((n, 6))
    wrench[:, 2] = -GRAVITY * mass
    before, after = settle_both(cell.plant, campaign.scenario.truth, q, wrench, point)
    moved = [after.theta - before.theta, *(_bent(cell, r, q, (wrench, point)) for r in found)]
    names = list(cell.arm.markers)
    rest = _points(cell, names, q, np.zeros_like(before.theta))
    aside = rest[0, :, :2][np.linalg.norm(rest[0, :, :2], axis=-1).argmax()]
    sides = np.array([[*(aside / np.linalg.norm(aside)), 0.0], [0.0, 0.0, 1.0]])
    bend, *bends = (_points(cell, names, q, theta) - rest for theta in moved)
    frames = elastic_frames(cell.plant, q, ENLARGED * moved[0])
    shapes = [outlines(cell, frames, k, sides) for k in range(n)]
    sag = Sag(shapes, on_tool(cell, frames, point) @ sides.T, _rms_mm(bend))
    return sag, [_miss(own - bend, sides) for own in bends]


def _miss(off: Array, sides: Array) -> Miss:
    """A model's error of its own at every marker, (loads, markers, 3) [m]."""
    middle = off.mean(axis=1) @ sides.T
    size = np.linalg.norm(middle, axis=-1, keepdims=True)
    return Miss(np.divide(middle, size, out=np.zeros_like(middle), where=size > 0), _rms_mm(off))


def _rms_mm(moved: Array) -> Array:
    """RMS over the markers, (loads,)."""
    rms: Array = MM * np.sqrt((moved**2).sum(axis=-1).mean(axis=-1))
    return rms


def _bent(cell: Cell, model: Estimate, q: Array, load: tuple[Array, Array]) -> Array:
    """Links and joints as a model bends them, its laws of the joints included, (loads, n_theta) [m, rad]."""
    vjm = vjm_for_structure(cell.vjm, model.structure)
    return add_law_deflections(vjm, (model.C_theta @ generalised_load(evaluate_chain(vjm, q), *load)).T)


def _points(cell: Cell, names: Sequence[str], q: Array, theta: Array) -> Array:
    return body_origins(cell.room, names, elastic_frames(cell.plant, q, theta))


def _pictures(mass: Array, sag: Sag, models: Sequence[Miss]) -> Iterator[bytes]:
    """A picture a load."""
    best = min(range(len(models)), key=lambda k: models[k].size_mm[-1])
    title = f"{mass[-1]:.0f} kg on a KUKA KR 500: which model predicts the sag?"
    edge = WIDE * max(float(miss.size_mm.max()) for miss in models)
    for k, kg in enumerate(mass.tolist()):
        figure = Figure(figsize=SIZE, dpi=DPI, facecolor="white")
        canvas = FigureCanvasAgg(figure)
        figure.text(0.5, 0.925, title, size=16.5, weight="bold", ha="center")
        _arm(figure.add_axes((0.01, 0.14, 0.37, 0.62), frameon=False), sag, k, kg)
        figure.text(
            0.195,
            0.79,
            f"True sag: {sag.size_mm[k]:.1f} mm\n(drawn {ENLARGED:.0f} times larger)",
            size=14,
            ha="center",
            color=WORDS,
        )
        for own, (miss, (name, colour)) in enumerate(zip(models, SHOWN.values(), strict=True)):
            left, shade = 0.39 + 0.203 * own, hexadecimal(colour)
            middle = left + 0.1
            figure.text(middle, 0.79, name, size=14, weight="bold", ha="center", color=shade)
            axes = figure.add_axes((left, 0.4, 0.2, 0.3556), frameon=False)
            axes.set(xlim=(-edge, edge), ylim=(-edge, edge), xticks=[], yticks=[], aspect="equal")
            _target(axes, miss, k, shade)
            figure.text(
                middle, 0.3, f"{miss.size_mm[k]:.2f} mm", size=21, weight="bold", ha="center", color=shade
            )
            off = "off: best" if k == len(mass) - 1 and own == best else "off"
            figure.text(middle, 0.235, off, size=16, weight="bold", ha="center", color=shade)
        close = f"The tool seen close up: rings every {RING} mm"
        figure.text(0.69, 0.14, close, size=14, ha="center", color=WORDS)
        caption = "Grey: true arm.  Colour: the model's prediction.  Arrow: its error."
        figure.text(0.5, 0.035, caption, size=14.5, ha="center")
        data = io.BytesIO()
        canvas.print_png(data)  # type: ignore[no-untyped-call]
        yield data.getvalue()


def _arm(axes: Axes, sag: Sag, k: int, kg: float) -> None:
    """Draw the true arm under a load, and behind it the arm without load, paler."""
    points = np.concatenate([polygon for own in (0, -1) for polygon in sag.shapes[own][0]])
    low, high = points.min(axis=0), points.max(axis=0)
    axes.axhline(low[1], color=LINE, lw=1.5)
    draw_arm(axes, sag.shapes[0][0], np.ones_like(sag.shapes[0][1]), GHOST)
    draw_arm(axes, *sag.shapes[k])
    _weight(axes, sag.hook[k], kg)
    axes.set(xticks=[], yticks=[], aspect="equal")
    axes.set(xlim=(low[0] - 0.05, high[0] + 0.3), ylim=(low[1] - 0.05, high[1] + 0.05))


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
        size=14,
        weight="bold",
        color=purple,
        ha="center",
        va="top",
        zorder=7,
    )


def _target(axes: Axes, miss: Miss, k: int, colour: str) -> None:
    """Draw where the tool truly is, a disc, and where the model puts it, a circle, to one scale."""
    for radius in np.arange(RING, axes.get_xlim()[1], RING):
        axes.add_patch(Circle((0, 0), radius, fill=False, ec=LINE, lw=1.5))
    size = float(miss.size_mm[k])
    x, z = size * miss.way[k]
    axes.plot(0, 0, "o", ms=11, color="0.65", zorder=5)
    axes.plot(x, z, "o", ms=13, mfc="none", mec=colour, mew=2.5, zorder=6, clip_on=False)
    if size > 0:
        head = {"head_length": min(HEAD, size), "head_width": 0.8 * min(HEAD, size)}
        axes.arrow(0, 0, x, z, color=colour, width=0.06, length_includes_head=True, lw=0, zorder=7, **head)


if __name__ == "__main__":
    sys.exit(command.run(app))
