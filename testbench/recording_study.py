"""What a recording draws, as arrays: order of the runs, arm and ghost, camera, histograms."""

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from testbench import recording_text as text
from testbench.bench import Campaign, Cell, Result
from testbench.dataset import Ids, Mask
from testbench.errors import Array
from testbench.plant.shapes import Frames, body_names, elastic_frames, rigid_frames
from testbench.report import UM, Report

RESIDUAL_FACTOR = 20
"""Residuals are drawn that much larger than deflections: at 50 x an arrow of 1 m is 1 mm."""

BINS = 17

HALF_VIEW = np.tan(np.deg2rad(27.5))
"""Tangent of half the viewer's vertical angle of view; the pane is a little wider than high."""

THICKNESS = 0.04
"""How far a shape reaches beyond the origin of its body, over the reach of the arm [1]."""


@dataclass(frozen=True)
class Study:
    """A campaign and its results, made ready for drawing.

    Attributes:
        report: The numbers.
        cell: The arm.
        campaign: The data.
        results: One a model.
        best: Index of the best model, which the runs are sorted by.
        shown: Indices of the models that are visible at first: the best of each method.
        residual: Residual of the worst marker, (models, runs) [m].
        checked: Which runs are of the check poses, (runs,).
        rank: Place of each run in worst_first, (runs,); 0 has the largest residual of the best model.
        rigid: The arm without its load and without any sag.
        ghost: The arm under its load, the deflection magnified.
        magnification: Of the deflection [1].
    """

    report: Report
    cell: Cell
    campaign: Campaign
    results: Sequence[Result]
    best: int
    shown: tuple[int, ...]
    residual: Array
    checked: Mask
    rank: Ids
    rigid: Frames
    ghost: Frames
    magnification: float

    @property
    def names(self) -> list[str]:
        """Names of the models."""
        return [result.model.name for result in self.results]

    @property
    def paths(self) -> list[str]:
        """The same in snake case, for paths."""
        return [re.sub(r"\W+", "_", name.lower()) for name in self.names]

    @property
    def worst(self) -> int:
        """Index of the run that worst_first begins with."""
        return int(np.argmin(self.rank))

    @property
    def reach(self) -> float:
        """Largest distance of a body from the foot of the arm in these runs, the scale of all symbols [m]."""
        return float(np.linalg.norm(self.rigid.positions - self.rigid.positions[:, :1], axis=-1).max())

    def bodies(self, names: Sequence[str], frames: Frames) -> Array:
        """Origins of named bodies, (runs, len(names), 3) [m]."""
        known = body_names(self.cell.room)
        return frames.positions[:, [known.index(name) for name in names]]


def build_study(
    report: Report, cell: Cell, campaign: Campaign, results: Sequence[Result], magnification: float
) -> Study:
    """Sort the runs, choose what is shown and place the arm.

    Args:
        report: The numbers of this campaign.
        cell: The arm.
        campaign: What was measured.
        results: One a model, in the order of the report's.
        magnification: Of the drawn deflection [1].
    """
    data, rows = campaign.measured, report["models"]
    best = rows.index(text.best(rows, "check"))
    champions = [text.best(group, "check") for group in text.by_method(rows) if group]
    residual = np.array([np.linalg.norm(r.residuals, axis=-1).max(axis=1) for r in results])
    rank = np.empty(data.runs, dtype=int)
    rank[np.argsort(-residual[best], kind="stable")] = np.arange(data.runs)
    sag = campaign.after.theta - campaign.before.theta
    return Study(
        report=report,
        cell=cell,
        campaign=campaign,
        results=results,
        best=best,
        shown=tuple(k for k, row in enumerate(rows) if row in champions),
        residual=residual,
        checked=np.isin(data.pose, campaign.check.pose),
        rank=rank,
        rigid=rigid_frames(cell.room, data.q),
        ghost=elastic_frames(cell.plant, data.q, magnification * sag),
        magnification=magnification,
    )


def moves(study: Study, body: int) -> bool:
    """Whether a body's ghost ever stands off the body far enough not to flicker through its surface."""
    a, b = study.rigid, study.ghost
    shift = np.linalg.norm(b.positions[:, body] - a.positions[:, body], axis=1)
    turn = np.linalg.norm(b.rotations[:, body] - a.rotations[:, body], axis=(1, 2)) / np.sqrt(2)
    return bool((shift + 0.2 * study.reach * turn).max() > 0.005 * study.reach)


def camera(study: Study) -> tuple[Array, Array]:
    """Eye and target, each (3,) [m]: from the side and a little ahead, arm and ghost of all runs in view."""
    weight = study.bodies([study.cell.arm.load], study.ghost) - [0, 0, 0.3 * study.reach]
    drawn = (study.rigid.positions, study.ghost.positions, weight)
    points = np.concatenate([positions.reshape(-1, 3) for positions in drawn])
    tool = study.bodies([study.cell.arm.tool], study.rigid)[:, 0, :2].mean(axis=0)
    length = float(np.linalg.norm(tool))
    x, y = tool / length if length > 0 else (1.0, 0.0)
    back = np.array([0.9 * y + 0.35 * x, -0.9 * x + 0.35 * y, 0.25])
    back /= np.linalg.norm(back)
    right = np.array([-back[1], back[0], 0]) / np.hypot(back[0], back[1])
    axes = np.column_stack([back, right, np.cross(back, right)])
    low, high = (points @ axes).min(axis=0), (points @ axes).max(axis=0)
    target = axes @ ((low + high) / 2)
    depth, across, up = ((points - target) @ axes).T
    wide = np.maximum(np.abs(across) / 1.15, np.abs(up)) + THICKNESS * study.reach
    distance = float((depth + wide / HALF_VIEW).max())  # the point that needs most
    return target + distance * back, target


def noise_limit(study: Study) -> float:
    """95th percentile of the largest of m noisy deflections, each of three normal components [m]."""
    data = study.campaign.measured
    share = 0.95 ** (1 / len(data.markers))
    return float(data.sigma * np.sqrt(2 * stats.chi2.ppf(share, 3)))


@dataclass(frozen=True)
class Bars:
    """A bar chart.

    Attributes:
        at: Centres, (bars,) [um].
        counts: Heights, (bars,) [1].
        width: Of every bar [um].
    """

    at: Array
    counts: Array
    width: float


def histograms(study: Study, runs: Mask) -> tuple[Bars, list[Bars]]:
    """Residual components of the shown models over some runs.

    Args:
        study: Gives residuals and noise.
        runs: Which runs, (runs,).

    Returns:
        The normal curve of the noise, as fine bars, and the bars of each shown model, side by side.
    """
    pooled = UM * np.array([study.results[k].residuals for k in study.shown])
    edge = 50 * max(1.0, float(np.ceil(np.abs(pooled).max() / 50)))
    edges = np.linspace(-edge, edge, BINS + 1)
    wide, count = 2 * edge / BINS, len(pooled)
    slot, middle = 0.8 * wide / count, (edges[:-1] + edges[1:]) / 2
    components = pooled[:, runs].reshape(count, -1)
    bars = [
        Bars(middle + slot * (i - (count - 1) / 2), np.histogram(x, edges)[0].astype(float), slot)
        for i, x in enumerate(components)
    ]
    fine = np.linspace(-edge, edge, 8 * BINS + 1)
    density = stats.norm.pdf(fine, scale=UM * study.campaign.measured.sigma * np.sqrt(2))
    curve = Bars(fine, wide * components.shape[1] * density, fine[1] - fine[0])
    return curve, bars
