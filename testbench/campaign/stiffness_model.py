"""A stiffness of `testbench identify` as a folder, written and read; any model of an arm by its folder."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from testbench.arm.folder import Arm
from testbench.campaign import model_folder
from testbench.campaign.absolute_model import read_whole
from testbench.campaign.advice import advice
from testbench.campaign.campaign import Cell
from testbench.campaign.model_document import CalibrationDocument, StiffnessDocument, StructureRow
from testbench.errors import Array, InputError, check_array
from testbench.identify.arm_model import ArmModel, bending, of_compliances
from testbench.identify.estimate import is_conservative
from testbench.identify.metric import Belief
from testbench.identify.posterior import Posterior, linearise
from testbench.model.kinematics import build_vjm
from testbench.model.load import Load, resultant
from testbench.model.structure import Structure, labels_of
from testbench.model.vjm import tool_pose
from testbench.model.weights import Weights, read_weights
from testbench.output.replace import reading

if TYPE_CHECKING:  # who only reads a model needs no fits
    from testbench.campaign.fits import Identified
    from testbench.campaign.runs import Runs

ARRAYS = ("pi", "root", "unseen", "scale")  #: Of posterior.npz: those of `Posterior`, pi its x.


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
        found = model_folder.read_document(folder, StiffnessDocument, CalibrationDocument)
        if arm is not None:
            model_folder.check_arm(folder, found, arm)
        if not isinstance(found, StiffnessDocument):
            return read_whole(folder, found)
        own = model_folder.read_arm(folder, found, meshes=True)
        arrays = model_folder.read_arrays(folder, found, ARRAYS)
        with model_folder.numbers_of(folder):
            return _model(found, own, arrays)


def _model(found: StiffnessDocument, arm: Arm, arrays: Sequence[Array]) -> ArmModel:
    pi, root, unseen, scale = arrays
    structure = _structure(found.structure, arm)
    n = structure.n
    if not np.array_equal(pi, [entry.value for entry in found.structure.entries]):
        raise ValueError(f"pi of {model_folder.POSTERIOR} and structure.entries are of two models")
    C = structure.matrix(check_array(pi, (n,), "pi"))
    _check_blocks(found, arm, structure, C)
    tail = found.spread.degrees_of_freedom
    known = Posterior(
        x=pi,
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
    state = bending(build_vjm(arm), C, model_folder.weights_of(found.weights, arm))
    return of_compliances(state, structure, known, model_folder.about_of(found.about))


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


def write_stiffness(
    cell: Cell, found: "Identified", runs: "Runs", data: Mapping[str, str], folder: Path
) -> None:
    """Write the model to take into a folder that exists; `data` has the SHA-256 of every file of readings."""
    fits, estimate, used = found.fits, found.taken, runs.used
    (weights, notes), spread, own = weights_known(cell.arm), linearise(estimate), estimate.structure
    [row] = [m for m in fits.models if m.name == fits.recommended]
    loads = resultant(tool_pose(cell.vjm, used.q)[1], [Load(used.wrench, used.point)])
    doubts = [*(doubt.sentence for doubt in fits.doubts), *notes]
    said = {
        "name": fits.recommended,
        "conservative": estimate.conservative,
        "structure": {
            "name": own.name,
            "symmetric": own.symmetric,
            "entries": [
                {"row": own.labels[a], "column": own.labels[b], "value": value}
                for a, b, value in zip(own.a, own.b, estimate.pi.tolist(), strict=True)
            ],
        },
        "links": dict(row.links),
        "joints": dict(row.joints),
        "units": row.units,
        "prior": None if estimate.belief is None else _prior(estimate.belief),
        "runs": {
            "runs": used.runs,
            "poses": len(np.unique(used.pose)),
            "held_back": [] if runs.check is None else np.unique(runs.check.pose).tolist(),
            "rejected": len(estimate.rejected),
            "sigma_m": used.sigma,
            "sigma_rotation_rad": used.sigma_rotation,
        },
        "certificate": {
            key: getattr(row, key)
            for key in ("status", "f_m", "f_m_floor", "duality_gap", "f_m_excess_bound")
        },
        "unseen": {
            "directions": own.n - estimate.regression.rank,
            "without_bound": len(spread.unseen),
            "stiffer": list(fits.unchecked.stiffer),
            "softer": list(fits.unchecked.softer),
            "words": list(advice(estimate)),
        },
        "spread": {
            "degrees_of_freedom": _finite(spread.tail),
            "heavy_rows": spread.heavy,
            "pull": spread.pull,
            "on_boundary": spread.on_boundary,
        },
        "weights": model_folder.weights_said(weights),
        "notes": [*notes, *fits.notes],
        "about": model_folder.about_said(f"{fits.recommended}: {estimate.method}", data, doubts, [loads]),
    }
    arrays = dict(zip(ARRAYS, (spread.x, spread.root, spread.unseen, spread.scale), strict=True))
    model_folder.write_parts(StiffnessDocument, cell.arm, said, folder, **arrays)


def weights_known(arm: Arm) -> tuple[Weights, list[str]]:
    """What the links weigh, and a note where nobody knows: own weight is then left out."""
    try:
        return read_weights(arm), []
    except InputError as err:
        bodies = arm.n_joints + 2
        return Weights(np.zeros(bodies), np.zeros((bodies, 3))), [f"Own weight is left out: {err}"]


def _prior(belief: Belief) -> object:
    strength = belief.strength
    return {
        "name": belief.metric.prior,
        "learnt": belief.moves is not None,
        "uncertainty": float(strength.uncertainty),
        "scale_uncertainty": _finite(strength.scale_uncertainty),
        "coupling": None if strength.coupling is None else float(strength.coupling),
        "misfit": float(belief.misfit),
        "scales": [
            {"name": one.name, "factor": float(one.factor), "deviation": _finite(one.deviation)}
            for one in belief.scales
        ],
    }


def _finite(x: float) -> float | None:
    return float(x) if math.isfinite(x) else None
