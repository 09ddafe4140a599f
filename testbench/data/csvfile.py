"""Measured runs as CSV: a row is one marker of one run, the unit is in the column's name.

Numbers are written in full, so that reading gives them back bit by bit. `columns` is the documented header.
"""

import csv
import io
from pathlib import Path

import numpy as np

from testbench.arm.folder import Arm
from testbench.data.cells import as_cell
from testbench.data.dataset import Dataset
from testbench.data.export import read_export
from testbench.data.names import ENTRIES, XYZ
from testbench.errors import BenchError
from testbench.output.whole import write_whole

READINGS = [f"{when}_{x}_m" for when in ("before", "after") for x in XYZ]
COVARIANCES = [f"deflection_cov_{name}_m2" for name in ENTRIES]
TURNED = [f"rotation_{when}_{x}_rad" for when in ("before", "after") for x in XYZ] + ["sigma_rad"]


def columns(arm: Arm | tuple[str, ...], *, rotation: bool, covariance: bool = False) -> list[str]:
    """The header of the CSV file, in order.

    run, pose: integers. marker: its name in the arm. JOINT_rad: joint angle, JOINT_m of a slide. force_*_N,
    moment_*_Nm: load, world axes. point_*_m: where it acts, tool's frame. before_*_m, after_*_m: readings,
    world axes. sigma_m: standard deviation of one reading along one axis, the same in all rows.

    With `rotation` orientations are read: rotation_before_*_rad, rotation_after_*_rad (rotation vectors,
    world axes, the same for every marker of a run) and sigma_rad. With `covariance` every reading has one of
    its own: deflection_cov_*_m2, of both readings together, world axes; a lost target leaves them and its
    readings empty. The set-up of the tracker stands in station, an integer, where there are several; readings
    are then in its frame.
    """
    names = ["run", "pose", "marker", *_joints(arm), *_load(), *READINGS, "sigma_m"]
    return names + TURNED * rotation + COVARIANCES * covariance


def _joints(arm: Arm | tuple[str, ...]) -> list[str]:
    return [j.column for j in arm.joints] if isinstance(arm, Arm) else [f"{name}_rad" for name in arm]


def _load() -> list[str]:
    return [pattern.format(x) for pattern in ("force_{}_N", "moment_{}_Nm", "point_{}_m") for x in XYZ]


def write_csv(data: Dataset, arm: Arm | tuple[str, ...], path: str | Path) -> None:
    """Write the dataset; an existing file is replaced only by a whole one.

    Args:
        data: The runs.
        arm: The arm that was measured, or the names of its hinges: they head the columns.
        path: The file.

    Raises:
        BenchError: When the names are not as many as the joint angles.
        InputError: When the file cannot be written.
    """
    write_whole(csv_text(data, arm), Path(path))


def csv_text(data: Dataset, arm: Arm | tuple[str, ...]) -> str:
    """The same as text."""
    joints = _joints(arm)
    if len(joints) != data.q.shape[1]:
        raise BenchError(f"joints: expected {data.q.shape[1]} names, got {joints}")
    m, turned = len(data.markers), data.rotation_before is not None
    header = columns(arm, rotation=turned, covariance=data.precision is not None)
    parts = [np.repeat(a, m, axis=0) for a in (data.q, data.wrench, data.point)]
    parts += [a.reshape(-1, 3) for a in (data.before, data.after)] + [np.full((data.points, 1), data.sigma)]
    if data.rotation_before is not None and data.rotation_after is not None:
        parts += [np.repeat(a, m, axis=0) for a in (data.rotation_before, data.rotation_after)]
        parts += [np.full((data.points, 1), data.sigma_rotation)]
    if data.precision is not None:
        C = data.covariance.reshape(-1, 3, 3)
        parts += [C[:, a, b, None] for a, b in ENTRIES.values()]
    lines = [list(map(repr, row)) for row in np.hstack(parts).tolist()]
    for row in np.flatnonzero(~data.seen):
        for name in READINGS + COVARIANCES:
            lines[row][header.index(name) - 3] = ""
    if data.station is not None:
        header = [*header, "station"]
        lines = [[*row, str(own)] for row, own in zip(lines, np.repeat(data.station, m), strict=True)]
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(map(as_cell, header))
    markers = tuple(map(as_cell, data.markers))
    ids = zip(np.repeat(data.run, m), np.repeat(data.pose, m), markers * data.runs, strict=True)
    writer.writerows([*own, *line] for own, line in zip(ids, lines, strict=True))
    return text.getvalue()


def read_csv(path: str | Path, arm: Arm) -> Dataset:
    """Read and check a dataset of an arm.

    Args:
        path: The file: `columns` documents ours, docs/formats.md every other form.
        arm: The arm that was measured.

    Returns:
        Readings before and after loading, with poses and loads.

    Raises:
        InputError: Names the line and what was expected.
    """
    return read_export(Path(path), arm).data
