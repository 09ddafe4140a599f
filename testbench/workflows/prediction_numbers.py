"""Numbers of a prediction: every pose and point as a table, the poses that move most, a map of stiffness."""

import csv
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from testbench.arm.folder import ArmJoint
from testbench.errors import Array
from testbench.files.table import as_cell
from testbench.identify.posterior import CONFIDENCE
from testbench.runs.rows import Row, finite
from testbench.workflows.ellipsoids import ellipsoids, some_poses
from testbench.workflows.program import Predicted, direction_words, extrapolation_warnings
from testbench.workflows.rows import MM
from testbench.workflows.workspace_errors import Meaning, bounded_mm, error_places, places_at

TABLE = "predictions.csv"
LISTED_POSES = 14  #: Poses that a report lists.
MOVED_BY, HALF_WIDTH = "moved by the force", "half width, 95 %"  #: What a map tells of a place.


def prediction_columns(joints: Sequence[ArmJoint]) -> list[str]:
    """List the columns of predictions.csv, in order; docs/formats.md says what each holds."""
    names = ["pose", "line", "point", *(joint.column for joint in joints)]
    names += [f"{axis}_m" for axis in "xyz"]
    names += [f"{what}_{axis}_m" for what in ("position_half_95", "deflection", "half_95") for axis in "xyz"]
    names += [f"rotation_{axis}_rad" for axis in "xyz"]
    return [*names, *(f"stiffness_{k}_N_per_m" for k in (1, 2, 3)), *(f"softest_{axis}" for axis in "xyz")]


def write_predictions(made: Predicted, folder: Path) -> None:
    """Write predictions.csv: all poses and points.

    What no reading has seen, and a stiffness where nothing gives, is blank.

    Args:
        made: The prediction.
        folder: Where the file goes.
    """
    prediction, tool = made.found, made.stiffness
    of_tool = np.hstack([prediction.rotation_vector, tool.principal, tool.softest])
    parts = (
        prediction.position,
        prediction.position_half_width,
        prediction.deflection,
        prediction.half_width,
    )
    names = [as_cell(name) for name in made.names]
    with (folder / TABLE).open("w", encoding="utf-8", newline="") as file:
        rows = csv.writer(file, lineterminator="\n")
        arm = made.model.arm
        rows.writerow(prediction_columns(arm.file_joints))
        for k, label in enumerate(made.asked.labels):
            first = [as_cell(label), str(made.asked.line[k])]
            joints, last = [*map(repr, arm.to_file(made.asked.q[k]).tolist())], _cells(of_tool[k])
            for m, name in enumerate(names):
                own = _cells(*(values[k, m] for values in parts))
                rows.writerow([*first, name, *joints, *own, *last])


def _cells(*values: Array) -> list[str]:
    """Ten digits of each, blank where infinite."""
    return [f"{x:.10g}" if np.isfinite(x) else "" for part in values for x in part.tolist()]


def numbers(made: Predicted) -> Row:
    """Collect all numbers but those of every pose, which are in predictions.csv; keys of report.json."""
    prediction, size = made.found, MM * made.found.size
    about, extent = made.model.about, made.extent
    some = np.array([made.stiffness.displacement_per_force[:, 0].argmax(), *made.worst_first[:LISTED_POSES]])
    poses = [_pose(made, int(k), half) for k, half in zip(some, made.push_halves(some), strict=True)]
    return Row(
        arm=made.model.arm.name,
        absolute=made.model.absolute,
        method=about.method,
        file=made.asked.path.name,
        loads=made.asked.words or "no load",
        poses=len(size),
        confidence_percent=100 * CONFIDENCE,
        least_mm=float(size[:, 0].min()),
        median_mm=float(np.median(size[:, 0])),
        most_mm=float(size[:, 0].max()),
        unseen_percent=float(100 * np.isinf(prediction.half_width).any(axis=2).mean()),
        other_off_mm=float(MM * prediction.linearisation_error.max()),
        position_half_mm=finite(MM * np.median(prediction.position_half_width[:, 0].max(axis=1))),
        force_n=extent.force,
        moment_nm=extent.moment,
        force_ratio=finite(extent.force_ratio),
        moment_ratio=finite(extent.moment_ratio),
        extrapolated=extrapolation_warnings(extent),
        doubts=about.doubts,
        notes=made.asked.notes,
        softest=poses[0],
        worst=poses[1:],
        map=_map(made),
        ellipsoids=_ellipsoids(made),
    )


def _ellipsoids(made: Predicted) -> list[Row]:
    """Describe over which ellipsoid the force of the map moves the loaded tool, in some poses of the file."""
    some = some_poses(len(made.asked.q))
    position, labels = made.found.position[some, 0], [made.asked.labels[k] for k in some]
    compliance = made.stiffness.compliance[some]
    return ellipsoids(compliance, 0 * position, position, labels, made.map.force)


def _pose(made: Predicted, k: int, push_half: float) -> Row:
    """How far its loads move the tool in a pose, by its number from 0, and how stiff the tool is there.

    None where the data of the model see nothing, or where nothing gives. Half widths are the widest along x,
    y, z. `push_mm` is how far the force of the map moves the loaded tool in its softest direction; its half
    width is that of this force.
    """
    prediction, file_poses, direction = made.found, made.asked, made.stiffness.softest[k]
    half = finite(MM * prediction.widest[k, 0])
    return Row(
        pose=file_poses.labels[k],
        line=int(file_poses.line[k]),
        joints=made.model.arm.words(file_poses.q[k]),
        tool_m=prediction.position[k, 0].tolist(),
        deflection_mm=float(MM * prediction.size[k, 0]),
        deflections_mm=(MM * prediction.deflection[k, 0]).tolist(),
        half_mm=half,
        half_words="not seen" if half is None else f"{half:.3f}",
        halves_mm=[finite(x) for x in MM * prediction.half_width[k, 0]],
        turn_mrad=float(1e3 * np.linalg.norm(prediction.rotation_vector[k])),
        stiffness_n_per_um=[finite(x) for x in 1e-6 * made.stiffness.principal[k]],
        softest=direction_words(direction),
        softest_direction=direction.tolist(),
        push_mm=float(MM * made.map.force * made.stiffness.displacement_per_force[k, 0]),
        push_half_mm=finite(MM * push_half),
    )


def _map(made: Predicted) -> Row:
    """The worst deflection under a force in any direction, over poses of the workspace, the softest first."""
    stiffness_map = made.map
    worst: Array = MM * stiffness_map.worst
    workspace_poses = places_at(made.model.arm, stiffness_map.q, stiffness_map.position, stiffness_map.worst)
    values = {
        MOVED_BY: bounded_mm(stiffness_map.worst),
        HALF_WIDTH: bounded_mm(stiffness_map.half.max(axis=1)),
    }
    words = f"of the tool by {stiffness_map.force:,.0f} N in the worst direction, and its half width, 95 %"
    return Row(
        force_n=stiffness_map.force,
        places=len(worst),
        median_mm=float(np.median(worst)),
        p95_mm=float(np.percentile(worst, 95)),
        worst_mm=float(worst[0]),
        half_mm=finite(MM * stiffness_map.half[0].max()),
        unseen_percent=float(100 * np.isinf(stiffness_map.half).any(axis=1).mean()),
        at_m=stiffness_map.position[0].tolist(),
        joints=made.model.arm.words(stiffness_map.q[0]),
        softest=direction_words(stiffness_map.direction[0]),
        errors=error_places(workspace_poses, values, [MOVED_BY], Meaning("movement", words, "median")),
    )
