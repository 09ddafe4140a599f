"""What is drawn of a calibration in simulation, of the rows of its first seed: nobody simulates it again."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from testbench.campaign.baselines import JOINTS
from testbench.campaign.campaign import Cell, Setup, settle_both
from testbench.campaign.campaign_row import Runs, dataset_of
from testbench.campaign.rows import MM
from testbench.data.csvfile import write_csv
from testbench.data.dataset import Dataset, Ids, in_order, split
from testbench.errors import Array
from testbench.plant.shapes import elastic_frames, rigid_frames
from testbench.report.table import Row, Trials
from testbench.studies.study import AnyRun
from testbench.views.colours import LOAD, MEASURED, Look, look
from testbench.views.scene import Layer, Line, PlaceMap, Poses, RunChart, Scene, Seen, round_scale

ARROWS = 0.25  #: Length of an arrow longer than 95 % of all over the reach of the arm [1].
FORCE = 0.2  #: Length of the arrow of the largest force over the reach [1].
OVER = "Error in each pose, against the truth, RMS over the markers (mm)"
LEFT = "What is left in each run, against its readings, RMS over the markers (mm)"


@dataclass(frozen=True)
class _Group:
    """Poses of one kind, and what models leave of their deflections."""

    name: str
    names: Sequence[str]  #: Of its poses.
    data: Dataset
    wrong: Mapping[str, Array]  #: Deflections minus predictions by model, (runs, m, 3) [m].
    first: int = 0  #: The pose that is shown first.


def runs_of(cell: Cell, setup: Setup, first: Trials) -> tuple[Dataset, Dataset]:
    """All measured runs of the first seed, and the true ones that models are judged by.

    Args:
        cell: The arm.
        setup: Sigmas of its readings.
        first: Rows of the seed, that of the first model first.
    """
    kinds = [first.inside("drawn").inside(kind).columns.items() for kind in ("measured", "over")]
    rows = [Runs(**{name: cells[0] for name, cells in own}) for own in kinds]
    return dataset_of(cell, setup, rows[0]), dataset_of(cell, setup, rows[1])


def write_runs(run: AnyRun, cell: Cell, setup: Setup, poses: int | None = None) -> None:
    """dataset.csv of the first seed; of the first so many poses alone, None for all."""
    measured, _ = runs_of(cell, setup, run.first)
    own = measured if poses is None else split(measured, np.arange(poses) + 1)[0]
    write_csv(own, cell.arm, run.folder / "dataset.csv")


def calibration_scene(run: AnyRun, cell: Cell, setup: Setup, fitted: int) -> Seen:
    """The arm in the poses that models are judged in and in all runs, with the errors of those compared.

    Args:
        run: Its report has models and a map, whose order of places is that of the page.
        cell: The true arm.
        setup: What was measured.
        fitted: How many poses, from 1, were fitted.
    """
    f, first, size = Row(run.report.numbers), run.first, run.settings.magnification
    names = first["name"].tolist()
    looks = {m.name: look(m.structure, m.constraint, m.prior) for m in f.models}
    shown = [name for name in dict.fromkeys((*f.map.compared, JOINTS)) if name in names]
    wrong, left = (
        {name: np.reshape(first[key][names.index(name)], (-1, len(cell.arm.markers), 3)) for name in shown}
        for key in ("drawn.wrong_m", "drawn.residuals_m")
    )
    measured, over = runs_of(cell, setup, first)
    order = _order(over, f.map.run)
    places = _Group(
        "Poses, against the truth",
        [f"Place {k} of {over.runs}" for k in range(1, over.runs + 1)],
        in_order(over, order),
        {name: own[order] for name, own in wrong.items()},
    )
    kinds = ["fitted" if pose <= fitted else "check" for pose in measured.pose.tolist()]
    said = [
        f"Run {run}, {kind} pose {pose}"
        for run, kind, pose in zip(measured.run.tolist(), kinds, measured.pose.tolist(), strict=True)
    ]
    worst = int(_mm(left[f.map.compared[-1]]).argmax())
    runs = _Group("Runs, against their readings", said, measured, left, worst)
    reach = float(np.linalg.norm(over.before[:, 0], axis=-1).max())
    far = np.linalg.norm([*places.wrong.values()], axis=-1)
    arrows = round_scale(ARROWS * reach, float(np.quantile(far, 0.95)))
    groups = [_poses(cell, setup, own, looks, (size, arrows)) for own in (places, runs)]
    at = np.array(f.map.position_m)
    return Seen(
        scene=Scene(cell, f"Deflections x {size:g}, arrows of errors x {arrows:g}.", groups),
        map=PlaceMap(OVER, 0, at, _lines(places, looks)),
        runs=[RunChart(LEFT, 1, "run", [str(run) for run in measured.run], _lines(runs, looks))],
    )


def _order(data: Dataset, runs: Sequence[int]) -> Ids:
    """Where each run of a map is."""
    at = {run: k for k, run in enumerate(data.run.tolist())}
    return np.array([at[run] for run in runs])


def _mm(wrong: Array) -> Array:
    """RMS over the markers of their distances, (runs,) [mm]."""
    return np.asarray(MM * np.sqrt((wrong**2).sum(axis=-1).mean(axis=-1)))


def _lines(own: _Group, looks: Mapping[str, Look]) -> list[Line]:
    return [Line(name, looks[name], _mm(wrong)) for name, wrong in own.wrong.items()]


def _poses(
    cell: Cell, setup: Setup, own: _Group, looks: Mapping[str, Look], scales: tuple[float, float]
) -> Poses:
    """The arm in every pose of a group, with arrows from where markers go to where each model has them."""
    data, (M, arrows) = own.data, scales
    before, after = settle_both(cell.plant, setup.truth, data.q, data.wrench, data.point)
    at, load = before.markers + M * data.deflection, data.wrench[:, :3]
    hook = before.tool + np.einsum("rxy,ry->rx", before.rotation, data.point)
    force = FORCE * np.linalg.norm(before.tool, axis=1).max() * load / (np.abs(load).max() or 1.0)
    moved = MM * np.linalg.norm(data.deflection, axis=-1).max(axis=1)
    errors = np.array([_mm(wrong) for wrong in own.wrong.values()]).T
    said = [
        f"Markers move up to {mm:.2f} mm. Error: "
        + ", ".join(f"{name} {x:.3f} mm" for name, x in zip(own.wrong, left, strict=True))
        + f". Joints at {cell.arm.words(q)}."
        for mm, left, q in zip(moved.tolist(), errors.tolist(), data.q, strict=True)
    ]
    layers = [
        Layer(f"error of {name}", looks[name].colour, "arrows", at, at - arrows * wrong)
        for name, wrong in own.wrong.items()
    ]
    return Poses(
        name=own.name,
        names=own.names,
        words=said,
        rigid=rigid_frames(cell.room, data.q),
        bent=elastic_frames(cell.plant, data.q, M * (after.theta - before.theta)),
        layers=[
            Layer("markers under load", MEASURED, "dots", at),
            Layer("force", LOAD, "arrows", hook[:, None], (hook + force)[:, None]),
            *layers,
        ],
        first=own.first,
    )
