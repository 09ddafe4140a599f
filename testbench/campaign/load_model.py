"""Models of an arm by their folders: a stiffness of `testbench identify`, or a calibration."""

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from testbench.arm.folder import Arm
from testbench.campaign.absolute_model import CALIBRATION, read_whole
from testbench.campaign.model_document import StiffnessDocument, StructureRow
from testbench.campaign.model_folder import (
    POSTERIOR,
    STIFFNESS,
    about_of,
    check_arm,
    numbers_of,
    read_arm,
    read_arrays,
    read_document,
    weights_of,
)
from testbench.correct.arm_model import ArmModel, bending, of_calibration, of_compliances
from testbench.errors import Array, check_array
from testbench.identify.estimate import is_conservative
from testbench.identify.intervals import Linearised
from testbench.model.kinematics import build_vjm
from testbench.model.structure import Structure, labels_of
from testbench.output.replace import reading

KINDS = {kind.name: kind for kind in (STIFFNESS, CALIBRATION)}
ARRAYS = ("pi", "root", "unseen", "scale")  #: Of posterior.npz: those of `identify.intervals.Linearised`.


def load_model(folder: str | Path, arm: str | Path | None = None) -> ArmModel:
    """Read a model that `testbench identify` or `testbench calibrate` wrote.

    Args:
        folder: Holds model.json, posterior.npz and the arm's files.
        arm: Folder of the arm that it must be a model of, or the name of one that comes with testbench; None
            for any.

    Returns:
        The arm as it was identified.

    Raises:
        InputError: When the folder holds none, one of a later version, one that was changed by hand, or one
            of another arm.
    """
    folder = Path(folder)
    with reading(folder):
        found = read_document(folder, KINDS)
        if arm is not None:
            check_arm(folder, found, arm)
        if not isinstance(found, StiffnessDocument):
            return of_calibration(*read_whole(folder, found))
        own = read_arm(folder, found, meshes=True)
        arrays = read_arrays(folder, found, ARRAYS)
        with numbers_of(folder):
            return _model(found, own, arrays)


def _model(found: StiffnessDocument, arm: Arm, arrays: Sequence[Array]) -> ArmModel:
    pi, root, unseen, scale = arrays
    structure = _structure(found.structure, arm)
    n = structure.n
    if not np.array_equal(pi, [entry.value for entry in found.structure.entries]):
        raise ValueError(f"pi of {POSTERIOR} and structure.entries are of two models")
    C = structure.matrix(check_array(pi, (n,), "pi"))
    _check_blocks(found, arm, structure, C)
    tail = found.spread.degrees_of_freedom
    spread = Linearised(
        pi=pi,
        root=check_array(root, (None, n), "root"),
        unseen=check_array(unseen, (None, n), "unseen"),
        scale=check_array(scale, (n,), "scale"),
        tail=math.inf if tail is None else tail,
        pull=found.spread.pull,
        on_boundary=found.spread.on_boundary,
        heavy=found.spread.heavy_rows,
    )
    if found.spread.heavy_rows > len(root):
        raise ValueError(f"spread.heavy_rows: expected at most the {len(root)} rows of root")
    state = bending(build_vjm(arm), C, weights_of(found.weights, arm))
    return of_compliances(state, structure, spread, about_of(found.about))


def _structure(row: StructureRow, arm: Arm) -> Structure:
    labels = labels_of(arm)
    place = {label: k for k, label in enumerate(labels)}
    names = {name for entry in row.entries for name in (entry.row, entry.column)}
    if unknown := sorted(names - set(labels)):
        raise ValueError(f"structure.entries: {arm.name} has no {unknown[0]!r}")
    pairs = [(place[entry.row], place[entry.column]) for entry in row.entries]
    told = {tuple(sorted(pair)) for pair in pairs} if row.symmetric else set(pairs)
    if not pairs or len(told) < len(pairs):
        raise ValueError("structure.entries: expected different ones, at least one")
    a, b = np.array(pairs).T
    return Structure(row.name, arm.n_theta, a, b, labels, row.symmetric)


def _check_blocks(found: StiffnessDocument, arm: Arm, structure: Structure, C: Array) -> None:
    """The blocks of links and joints are those of the entries; Gramians, where that is claimed."""
    links = {link.name: C[6 * k : 6 * k + 6, 6 * k : 6 * k + 6].tolist() for k, link in enumerate(arm.links)}
    if found.links != links:
        raise ValueError("links: expected the blocks that structure.entries have")
    own = np.diag(C)[6 * len(arm.links) :].tolist()
    said = [found.joints.get(joint.name, math.nan) for joint in arm.joints]
    if len(found.joints) != len(own) or any(x != (y or 0.0) for x, y in zip(own, said, strict=True)):
        raise ValueError("joints: expected the compliances that structure.entries have")
    if found.conservative and not is_conservative(structure, C):
        raise ValueError("conservative: expected symmetric positive semi-definite blocks")
