"""A calibrated arm as a folder: model.json and posterior.npz beside the arm's rigid.xml and elastic.toml."""

import shutil
import zipfile
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import ValidationError

from testbench import files
from testbench.arm.folder import Arm, load_arm
from testbench.bench.absolute_document import (
    Document,
    ErrorsRow,
    FrameRow,
    MountRow,
    NoiseRow,
    Rows,
    WeightsRow,
)
from testbench.errors import Array, BenchError, InputError, check_array, read_text
from testbench.identify.absolute.evidence import Choice
from testbench.identify.absolute.fit import Calibration
from testbench.identify.absolute.noise import KINDS, Noise
from testbench.identify.absolute.posterior import Belief
from testbench.identify.absolute.state import Frame, Mount, State
from testbench.identify.absolute.unknowns import Unknowns
from testbench.identify.metric import metric
from testbench.identify.prior import cad_prior
from testbench.model.joint_errors import JointErrors
from testbench.model.kinematics import build_vjm
from testbench.model.structure import all153, joints_only
from testbench.model.weights import Weights

DOCUMENT, POSTERIOR = "model.json", "posterior.npz"
ARM = ("rigid.xml", "elastic.toml")  #: Of the arm's folder.
MAX_BYTES, MAX_ROOT = 50_000_000, 300_000_000
TURN = 1e-6  #: Most that a rotation of a file differs from one [1].
STRUCTURES = {"joints": joints_only, "links": all153}
"""Compliances that a model may have."""


def write_model(calibration: Calibration, arm: Path, folder: Path) -> None:
    """Write a calibrated arm into a folder that exists."""
    for name in ARM:
        shutil.copyfile(arm / name, folder / name)
    belief = belief_of(calibration)
    files.write_json(_document(calibration, belief, folder).model_dump(), folder / DOCUMENT)
    elastic = belief.own.elastic
    L = np.zeros((0, 0)) if elastic is None else elastic.L
    np.savez_compressed(folder / POSTERIOR, root=belief.root, L=L)


def belief_of(calibration: Calibration) -> Belief:
    """What a calibration knows of the arm, whatever series it was learnt from."""
    own, errors = calibration.own, calibration.state.errors
    first = own.unknowns.starts["geometry"]
    frames = int((own.columns < first).sum())
    structure = joints_only(own.unknowns.vjm.arm) if own.elastic is None else own.elastic.structure
    unknowns = Unknowns(own.unknowns.vjm, (), {}, errors, structure)
    rigid = own.columns[frames : own.rigid] - first
    elastic = unknowns.starts["elastic"] + np.arange(len(own.columns) - own.rigid)
    columns = np.concatenate([rigid, elastic])
    return Belief(
        Choice(unknowns, columns, own.elastic), calibration.root[frames:, frames:], calibration.noise
    )


def _document(calibration: Calibration, belief: Belief, folder: Path) -> Document:
    state, own = calibration.state, calibration.own
    rigid: Literal["none"] = "none"
    kind = rigid if own.elastic is None else _kind(own.elastic.structure.n == state.vjm.arm.n_joints)
    return Document(
        format=1,
        kind="absolute calibration",
        arm=state.vjm.arm.name,
        digests={name: files.digest(folder / name) for name in ARM},
        compliances=kind,
        theta_0=state.theta_0.tolist(),
        C_theta=state.C_theta.tolist(),
        errors=ErrorsRow(
            orders=list(state.errors.orders),
            ratio=state.errors.ratio,
            play=state.errors.play,
            stiffening=state.errors.stiffening,
            coefficients=state.n.tolist(),
            torque_scale=state.torque_scale.tolist(),
        ),
        weights=WeightsRow(mass_kg=state.weights.mass.tolist(), centre_m=state.weights.centre.tolist()),
        noise=NoiseRow(
            open_position_m=float(calibration.noise.open_position),
            open_rotation_rad=float(calibration.noise.open_rotation),
            factor=calibration.noise.factor.tolist(),
        ),
        columns=belief.columns.tolist(),
        frames={
            name: FrameRow(rotation=one.rotation.tolist(), translation_m=one.translation.tolist())
            for name, one in state.frames.items()
        },
        mounts={
            name: MountRow(
                markers=list(one.markers), points_m=one.points.tolist(), rotation=one.rotation.tolist()
            )
            for name, one in state.mounts.items()
        },
    )


def _kind(joints: bool) -> Literal["joints", "links"]:
    return "joints" if joints else "links"


def read_model(folder: Path) -> tuple[State, Belief]:
    """A calibrated arm from its folder.

    Raises:
        InputError: When the folder is not one, or what it holds does not belong together.
    """
    path = folder / DOCUMENT
    if not folder.is_dir() or not path.is_file():
        raise InputError(folder, "", f"expected the folder of a calibrated arm, with {DOCUMENT}")
    try:
        found = Document.model_validate_json(read_text(path, MAX_BYTES))
    except ValidationError as err:
        first = err.errors(include_url=False, include_context=False)[0]
        place = ".".join(map(str, first["loc"]))
        raise InputError(path, place, f"{first['msg']}, got {str(first.get('input'))[:80]!r}") from err
    for name in ARM:
        if not (folder / name).is_file() or files.digest(folder / name) != found.digests.get(name):
            raise InputError(folder / name, "", "is not the arm that was calibrated; it has changed")
    arm = replace(load_arm(folder), name=found.arm)
    root, L = _posterior(folder / POSTERIOR)
    try:
        state = _state(found, arm)
        return state, _belief(found, state, root, L)
    except (BenchError, ValueError, IndexError) as err:
        raise InputError(path, "", f"numbers do not belong together: {err}") from err


def _posterior(path: Path) -> tuple[Array, ...]:
    """Root of the precision, (a, a), and L of the metric of the compliances in it, (e, e)."""
    try:
        if path.stat().st_size > MAX_ROOT:
            raise InputError(path, "", f"expected at most {MAX_ROOT} bytes")
        with zipfile.ZipFile(path) as packed:
            if sum(entry.file_size for entry in packed.infolist()) > MAX_ROOT:
                raise InputError(path, "", f"expected at most {MAX_ROOT} bytes when unpacked")
        with np.load(path, allow_pickle=False) as data:
            return tuple(check_array(data[name], (None, None), name) for name in ("root", "L"))
    except InputError:
        raise
    except (BenchError, OSError, ValueError, KeyError, MemoryError, zipfile.BadZipFile) as err:
        raise InputError(path, "", f"expected the posterior of a calibration: {err}") from err


def _state(found: Document, arm: Arm) -> State:
    vjm, n, joints = build_vjm(arm), arm.n_theta, arm.n_joints
    own = found.errors
    errors = JointErrors(tuple(own.orders), own.ratio, own.play, own.stiffening)
    C = check_array(np.array(found.C_theta), (n, n), "C_theta [m/N, rad/(N m)]")
    if not np.array_equal(C, C.T):
        raise ValueError("C_theta: expected a symmetric matrix")
    return State(
        vjm=vjm,
        weights=Weights(
            check_array(np.array(found.weights.mass_kg), (joints + 2,), "mass [kg]"),
            check_array(np.array(found.weights.centre_m), (joints + 2, 3), "centre [m]"),
        ),
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


def _belief(found: Document, state: State, root: Array, L: Array) -> Belief:
    """The metric is that of the day of the calibration, whatever it has become since."""
    rigid, arm = found.compliances == "none", state.vjm.arm
    structure = STRUCTURES["joints" if found.compliances == "none" else found.compliances](arm)
    unknowns = Unknowns(state.vjm, (), {}, state.errors, structure)
    columns, e = np.array(found.columns, dtype=int), 0 if rigid else structure.n
    if (np.diff(columns, append=unknowns.size) <= 0).any() or (
        columns >= unknowns.starts["elastic"]
    ).sum() != e:
        raise ValueError(f"columns: expected rising ones, those of {e} compliances last")
    check_array(root, (len(columns), len(columns)), "root")
    if np.tril(root, -1).any() or not np.diag(root).all():
        raise ValueError("root: expected an upper triangle without zeros on its diagonal")
    elastic = replace(metric(cad_prior(arm), state.vjm, structure), L=check_array(L, (e, e), "L"))
    factor = check_array(np.array(found.noise.factor), (len(KINDS),), "factor")
    noise = Noise(found.noise.open_position_m, found.noise.open_rotation_rad, factor)
    return Belief(Choice(unknowns, columns, None if rigid else elastic), root, noise)


def _rotation(rows: Rows, name: str) -> Array:
    R = check_array(np.array(rows), (3, 3), name)
    if np.abs(R @ R.T - np.eye(3)).max() > TURN or np.linalg.det(R) < 0:
        raise ValueError(f"{name}: expected a rotation")
    return R
