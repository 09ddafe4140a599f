"""Models of an arm as folders, written and read: stiffness of `testbench identify`, arms of `calibrate`."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from testbench.arm.folder import Arm
from testbench.campaign.advice import advice
from testbench.campaign.campaign import Cell
from testbench.campaign.model_document import CalibrationDocument, Document, Rows, StiffnessDocument
from testbench.campaign.model_folder import (
    POSTERIOR,
    about_said,
    numbers_of,
    read_document,
    read_parts,
    write_parts,
)
from testbench.data.dataset import Dataset
from testbench.data.series import Series
from testbench.errors import Array, InputError, check_array
from testbench.identify.absolute.fit import Calibration
from testbench.identify.absolute.noise import KINDS, Noise
from testbench.identify.absolute.posterior import deviations_root, model_of
from testbench.identify.absolute.state import Mount, State
from testbench.identify.absolute.unknowns import Unknowns
from testbench.identify.arm_model import About, ArmModel, bending, of_compliances
from testbench.identify.estimate import is_conservative
from testbench.identify.metric import Belief
from testbench.identify.posterior import Posterior, linearise
from testbench.identify.registration import Frame
from testbench.model.joint_errors import JointErrors
from testbench.model.kinematics import build_vjm
from testbench.model.laws import vjm_of, with_laws
from testbench.model.load import Load, resultant
from testbench.model.structure import Structure, all153, joints_only, labels_of
from testbench.model.vjm import Vjm, tool_pose
from testbench.model.weights import Weights, no_weights, read_weights
from testbench.output.whole import reading

if TYPE_CHECKING:  # who only reads a model needs no fits
    from testbench.campaign.fits import Identified
    from testbench.campaign.runs import Runs

TURN = 1e-6  #: Most that a rotation of a file differs from one [1].
STRUCTURES = {"none": joints_only, "joints": joints_only, "links": all153}
"""Compliances of a calibrated arm; of a rigid one they are all zero."""


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
    return _read(Path(folder), arm, StiffnessDocument, CalibrationDocument)


def read_model(folder: Path) -> ArmModel:
    """A calibrated arm from its folder; InputError where it holds none that is whole."""
    return _read(folder, None, CalibrationDocument)


def _read(folder: Path, arm: str | Path | None, *kinds: type[Document]) -> ArmModel:
    with reading(folder):
        found = read_document(folder, *kinds)
        own, weights, about, arrays = read_parts(folder, found, arm)
        with numbers_of(folder):
            if isinstance(found, StiffnessDocument):
                return _stiffness(found, (own, weights, about), arrays)
            assert isinstance(found, CalibrationDocument)
            return _calibration(found, _state(found, own, weights), about, arrays)


def _stiffness(
    found: StiffnessDocument, common: tuple[Arm, Weights, About], arrays: Sequence[Array]
) -> ArmModel:
    (arm, weights, about), (pi, root, unseen, scale) = common, arrays
    structure = _structure(found, arm)
    n = structure.n
    if not np.array_equal(pi, [entry.value for entry in found.structure.entries]):
        raise ValueError(f"pi of {POSTERIOR} and structure.entries are of two models")
    C = structure.matrix(check_array(pi, (n,), "pi"))
    _check_blocks(found, arm, structure, C)
    spread = found.spread
    known = Posterior(
        x=pi,
        root=check_array(root, (None, n), "root"),
        unseen=check_array(unseen, (None, n), "unseen"),
        scale=check_array(scale, (n,), "scale"),
        tail=math.inf if spread.degrees_of_freedom is None else spread.degrees_of_freedom,
        pull=spread.pull,
        on_boundary=spread.on_boundary,
        heavy=spread.heavy_rows,
    )
    if spread.heavy_rows > len(root):
        raise ValueError(f"spread.heavy_rows: expected at most the {len(root)} rows of root")
    vjm = vjm_of(build_vjm(arm), structure)
    return of_compliances(bending(vjm, C, weights), structure, known, about)


def _structure(found: StiffnessDocument, arm: Arm) -> Structure:
    row = found.structure
    lawful = with_laws(all153(arm), arm)
    labels, compliances = lawful.labels, labels_of(arm)
    place = {label: k for k, label in enumerate(labels)}
    names = {name for entry in row.entries for name in (entry.row, entry.column)}
    if unknown := sorted(names - set(labels)):
        raise ValueError(f"structure.entries: {arm.name} has no {unknown[0]!r}")
    pairs = [(place[entry.row], place[entry.column]) for entry in row.entries]
    told = {tuple(sorted(pair)) for pair in pairs} if row.symmetric else set(pairs)
    if not pairs or len(told) < len(pairs):
        raise ValueError("structure.entries: expected different ones, at least one")
    a, b = np.array(pairs).T
    if b.max() < arm.n_theta:
        return Structure(row.name, arm.n_theta, a, b, compliances, row.symmetric)
    return Structure(row.name, lawful.n_theta, a, b, labels, row.symmetric, lawful.laws)


def _check_blocks(found: StiffnessDocument, arm: Arm, structure: Structure, C: Array) -> None:
    """The blocks of links and joints are those of the entries; Gramians, where that is claimed."""
    links = {link.name: C[6 * k : 6 * k + 6, 6 * k : 6 * k + 6].tolist() for k, link in enumerate(arm.links)}
    if found.links != links:
        raise ValueError("links: expected the blocks that structure.entries have")
    own = np.diag(C)[6 * len(arm.links) : arm.n_theta].tolist()
    said = [found.joints.get(joint.name, math.nan) for joint in arm.joints]
    if len(found.joints) != len(own) or any(x != (y or 0.0) for x, y in zip(own, said, strict=True)):
        raise ValueError("joints: expected the compliances that structure.entries have")
    if found.conservative and not is_conservative(structure, C):
        raise ValueError("conservative: expected symmetric positive semi-definite blocks")


def _state(found: CalibrationDocument, arm: Arm, weights: Weights) -> State:
    vjm, n, joints = build_vjm(arm), arm.n_theta, arm.n_joints
    own = found.errors
    errors = JointErrors(tuple(own.orders), own.ratio, own.play, own.stiffening)
    C = check_array(np.array(found.C_theta), (n, n), "C_theta [m/N, rad/(N m)]")
    if not np.array_equal(C, C.T):
        raise ValueError("C_theta: expected a symmetric matrix")
    return State(
        vjm=vjm,
        weights=weights,
        theta_0=check_array(np.array(found.theta_0), (n,), "theta_0 [m, rad]"),
        C_theta=C,
        errors=errors,
        n=check_array(np.array(own.coefficients).reshape(joints, -1), (joints, errors.size), "errors"),
        torque_scale=check_array(np.array(own.torque_scale), (joints,), "torque_scale [N m, N]"),
        frames={
            name: Frame(
                _rotation(one.rotation, f"frame {name}"),
                check_array(np.array(one.translation_m), (3,), f"frame {name} [m]"),
            )
            for name, one in found.frames.items()
        },
        mounts={
            name: Mount(
                check_array(np.array(one.points_m), (len(one.markers), 3), f"mount {name} [m]"),
                _rotation(one.rotation, f"mount {name}"),
                tuple(one.markers),
            )
            for name, one in found.mounts.items()
        },
    )


def _calibration(found: CalibrationDocument, state: State, about: About, arrays: Sequence[Array]) -> ArmModel:
    """The metric is that of the day of the calibration, whatever it has become since."""
    (root, L), structure = arrays, STRUCTURES[found.compliances](state.vjm.arm)
    columns, e = np.array(found.columns, dtype=int), 0 if found.compliances == "none" else structure.n
    noise = Noise(
        found.noise.open_position_m,
        found.noise.open_rotation_rad,
        check_array(np.array(found.noise.factor), (len(KINDS),), "factor"),
    )
    unknowns = Unknowns(state.vjm, (), {}, state.errors, structure)
    if (np.diff(columns, append=unknowns.size) <= 0).any() or (
        columns >= unknowns.starts["elastic"]
    ).sum() != e:
        raise ValueError(f"columns: expected rising ones, those of {e} compliances last")
    check_array(root, (len(columns), len(columns)), "root")
    if np.tril(root, -1).any() or not np.diag(root).all():
        raise ValueError("root: expected an upper triangle without zeros on its diagonal")
    own = Posterior.normal(
        unknowns.current(state)[columns], deviations_root(root, check_array(L, (e, e), "L"))
    )
    return ArmModel(state, structure, columns, own, about, noise)


def _rotation(rows: Rows, name: str) -> Array:
    R = check_array(np.array(rows), (3, 3), name)
    if np.abs(R @ R.T - np.eye(3)).max() > TURN or np.linalg.det(R) < 0:
        raise ValueError(f"{name}: expected a rotation")
    return R


def write_stiffness(
    cell: Cell, found: "Identified", runs: "Runs", data: Mapping[str, str], folder: Path
) -> None:
    """Write the model to take into a folder that exists; `data` has the SHA-256 of every file of readings."""
    fits, estimate, used = found.fits, found.taken, runs.used
    (weights, notes), spread, own = weights_known(cell.arm), linearise(estimate), estimate.structure
    [row] = [m for m in fits.models if m.name == fits.recommended]
    loads = _about_tool(cell.vjm, used)
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
            "directions": estimate.of_compliances.structure.n - estimate.of_compliances.rank,
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
        "notes": [*notes, *fits.notes],
        "about": about_said(f"{fits.recommended}: {estimate.method}", data, doubts, loads),
    }
    arrays = {"pi": spread.x, "root": spread.root, "unseen": spread.unseen, "scale": spread.scale}
    write_parts(StiffnessDocument, cell.arm, weights, said, folder, **arrays)


def weights_known(arm: Arm) -> tuple[Weights, list[str]]:
    """What the links weigh, and a note where nobody knows: own weight is then left out."""
    try:
        return read_weights(arm), []
    except InputError as err:
        return no_weights(arm), [f"Own weight is left out: {err}"]


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


def write_model(
    calibration: Calibration, data: Mapping[str, str], doubts: Sequence[str], folder: Path
) -> None:
    """Write a calibrated arm into a folder that exists; `data` has the SHA-256 of every file of readings."""
    state, own, noise = calibration.state, calibration.own, calibration.noise
    elastic, errors, columns = own.elastic, state.errors, model_of(calibration).columns
    frames = len(own.columns) - len(columns)
    kept = [step.name for step in calibration.chosen.steps if step.kept]
    vjm = own.unknowns.vjm
    loads = np.concatenate([_about_tool(vjm, one) for one in calibration.series])
    method = f"absolute calibration: {', '.join(['geometry', *kept])}"
    joints = elastic is not None and elastic.structure.n == vjm.arm.n_joints
    said = {
        "compliances": "none" if elastic is None else "joints" if joints else "links",
        "theta_0": state.theta_0.tolist(),
        "C_theta": state.C_theta.tolist(),
        "errors": {
            **vars(errors),
            "orders": list(errors.orders),
            "coefficients": state.n.tolist(),
            "torque_scale": state.torque_scale.tolist(),
        },
        "noise": {
            "open_position_m": float(noise.open_position),
            "open_rotation_rad": float(noise.open_rotation),
            "factor": noise.factor.tolist(),
        },
        "columns": columns.tolist(),
        "frames": {
            name: {"rotation": one.rotation.tolist(), "translation_m": one.translation.tolist()}
            for name, one in state.frames.items()
        },
        "mounts": {
            name: {
                "markers": list(one.markers),
                "points_m": one.points.tolist(),
                "rotation": one.rotation.tolist(),
            }
            for name, one in state.mounts.items()
        },
        "about": about_said(method, data, doubts, loads),
    }
    L = np.zeros((0, 0)) if elastic is None else elastic.L
    root = calibration.root[frames:, frames:]
    write_parts(CalibrationDocument, vjm.arm, state.weights, said, folder, root=root, L=L)


def _about_tool(vjm: Vjm, data: Dataset | Series) -> Array:
    """Loads of every run or row about the tool's origin, world axes, (rows, 6) [N, N m]."""
    return resultant(tool_pose(vjm, data.q)[1], [Load(data.wrench, data.point)])
