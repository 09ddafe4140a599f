"""Errors of models pose by pose over a workspace: where each is largest, and where they differ most."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from testbench.arm.folder import Arm
from testbench.data.dataset import Dataset
from testbench.errors import Array, Ids
from testbench.model.vjm import tool_poses
from testbench.runs.rows import Row, finite
from testbench.workflows.cell import Cell
from testbench.workflows.rows import MM, rounded

PLACE_DIGITS = 4  #: Significant digits of a length that is kept: a report shows three.
Q_DECIMALS, M_DECIMALS = 5, 4
"""Decimals of joints [rad, m] and of tool positions [m]: a place is found again within 0.1 mm."""


@dataclass(frozen=True)
class ErrorMeaning:
    """State what the errors of a map are, and how they are averaged."""

    name: str  #: In a word or two.
    words: str  #: The same at length.
    typical: Literal["RMS", "median"]  #: What stands for a model's errors all over the workspace.


TRUE_ERROR = ErrorMeaning("error", "distance to the true deflection, RMS over the markers", "RMS")


@dataclass(frozen=True)
class WorkspacePoses:
    """Hold poses of a workspace, one entry per pose, as plain data of a trial's row."""

    run: tuple[int, ...]  #: Identifier in the campaign.
    q: tuple[float, ...]  #: Joint angles [rad, m], of all poses in turn.
    joints: tuple[str, ...]  #: The same for people.
    x_m: tuple[float, ...]  #: Tool without load, world axes.
    y_m: tuple[float, ...]
    z_m: tuple[float, ...]
    deflection_mm: tuple[float, ...]  #: True deflection, RMS over the markers.


@dataclass(frozen=True)
class ErrorPlaces:
    """Hold errors of models by place, columns of equal length; where `compared` differ most is first."""

    compared: tuple[str, ...]  #: Best of each method, the incumbent first, the recommended one last.
    run: Ids  #: Identifier in the campaign, (places,).
    q: Array  #: Joint angles, (places, joints) [rad, m].
    joints: tuple[str, ...]  #: The same for people.
    position_m: Array  #: Tool without load, world axes, (places, 3).
    deflection_mm: Array  #: True deflection, RMS over the markers; without truth the predicted, (places,).
    error_mm: Mapping[str, Array]  #: By name of the model, (places,) each; NaN where it has no bound.
    #: Of models with a bound, by name, where the error is largest: `place`, an index of these columns, with
    #: its `position_m`, `joints` and `error_mm`.
    worst: Mapping[str, Row]
    means: ErrorMeaning = TRUE_ERROR  #: What an error is.

    def typical_mm(self, name: str) -> float:
        """Compute a typical error of a model over places with a bound [mm]; NaN where none has."""
        mm = self.error_mm[name][np.isfinite(self.error_mm[name])]
        if not mm.size:
            return float("nan")
        return float(np.sqrt(np.mean(mm**2)) if self.means.typical == "RMS" else np.median(mm))

    def unbounded(self, name: str) -> int:
        """Count the places at which a model has no bound."""
        return int(np.isnan(self.error_mm[name]).sum())

    def rows(self) -> list[Row]:
        """List the typical and the largest error of every model that is compared, and where that is."""
        nowhere = Row(error_mm=None, position_m=(), joints="")
        worst = {name: self.worst.get(name, nowhere) for name in self.compared}
        return [
            Row(
                name=name,
                typical_mm=finite(self.typical_mm(name)),
                unbounded=self.unbounded(name),
                worst_mm=own.error_mm,
                place=", ".join(f"{x:.2f}" for x in own.position_m),
                joints=own.joints,
            )
            for name, own in worst.items()
        ]


def places_at(arm: Arm, q: Array, position: Array, moved: Array) -> WorkspacePoses:
    """Describe poses by number, joints, tool and deflection.

    Args:
        arm: Description of the arm.
        q: Poses, (n, joints) [rad, m].
        position: Tool of the unloaded arm, (n, 3) [m].
        moved: Deflection there, (n,) [m].

    Returns:
        The poses, numbered from 1.
    """
    x, y, z = position.round(M_DECIMALS).T.tolist()
    return WorkspacePoses(
        run=tuple(range(1, len(q) + 1)),
        q=tuple(q.round(Q_DECIMALS).ravel().tolist()),
        joints=tuple(map(arm.pose_text, q)),
        x_m=tuple(x),
        y_m=tuple(y),
        z_m=tuple(z),
        deflection_mm=tuple(rounded(MM * moved, PLACE_DIGITS)),
    )


def places_of(cell: Cell, data: Dataset) -> WorkspacePoses:
    """Describe the poses of noise-free runs: joints, position of the unloaded tool and true deflection.

    Args:
        cell: The arm with its model and its truth.
        data: Measured runs.

    Returns:
        The poses.
    """
    position, _ = tool_poses(cell.vjm, data.q)
    workspace_poses = places_at(cell.arm, data.q, position, rms(data.deflection))
    return replace(workspace_poses, run=tuple(data.run_id.tolist()))


def rms(moved: Array) -> Array:
    """Compute RMS lengths over the markers, (runs,) [m], of vectors (runs, m, 3) or (runs, 3 m) [m]."""
    vectors = moved.reshape(len(moved), -1, 3)
    return np.asarray(np.sqrt(np.mean(np.sum(vectors**2, axis=-1), axis=-1)))


def error_places(
    workspace_poses: WorkspacePoses,
    error_mm: Mapping[str, ArrayLike],
    compared: Sequence[str] = (),
    means: ErrorMeaning = TRUE_ERROR,
) -> ErrorPlaces:
    """Order places by how much the first and the last of the compared models differ, widest first.

    Of one model its greatest error comes first, of none that of the first.

    Args:
        workspace_poses: The poses.
        error_mm: Errors of every model by its name [mm]; None, NaN or infinity for no bound.
        compared: Names of the models that are compared.
        means: What an error is.

    Returns:
        The errors by place.
    """
    mm = {}
    for name, errors in error_mm.items():
        own = np.array(rounded(np.asarray(errors, dtype=float), PLACE_DIGITS))
        mm[name] = np.where(np.isfinite(own), own, np.nan)
    names = tuple(compared) or tuple(mm)[:1]
    first, last = (np.nan_to_num(mm[name], nan=np.inf) for name in (names[0], names[-1]))
    with np.errstate(invalid="ignore"):  # neither has a bound
        apart = first if len(names) == 1 else np.nan_to_num(np.abs(first - last), nan=0.0, posinf=np.inf)
    order = np.argsort(-apart, kind="stable")
    position = np.column_stack([workspace_poses.x_m, workspace_poses.y_m, workspace_poses.z_m])[order]
    joints = tuple(workspace_poses.joints[k] for k in order)
    mm = {name: own[order] for name, own in mm.items()}
    worst = {name: int(np.nanargmax(own)) for name, own in mm.items() if np.isfinite(own).any()}
    return ErrorPlaces(
        compared=names,
        run=np.array(workspace_poses.run)[order],
        q=np.reshape(workspace_poses.q, (len(order), -1))[order],
        joints=joints,
        position_m=position,
        deflection_mm=np.array(workspace_poses.deflection_mm)[order],
        error_mm=mm,
        worst={
            name: Row(
                place=k,
                position_m=tuple(position[k].tolist()),
                joints=joints[k],
                error_mm=float(mm[name][k]),
            )
            for name, k in worst.items()
        },
        means=means,
    )
