"""A calibrated arm as a folder: model.json and posterior.npz beside the arm's rigid.xml and elastic.toml."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from testbench.arm.folder import Arm
from testbench.campaign import model_folder
from testbench.campaign.model_document import CalibrationDocument, Document, Rows
from testbench.errors import Array, check_array
from testbench.identify.absolute.fit import Calibration
from testbench.identify.absolute.noise import KINDS, Noise
from testbench.identify.absolute.posterior import deviations_root, model_of
from testbench.identify.absolute.state import Mount, State
from testbench.identify.absolute.unknowns import Unknowns
from testbench.identify.arm_model import About, ArmModel
from testbench.identify.posterior import Posterior
from testbench.identify.registration import Frame
from testbench.model.joint_errors import JointErrors
from testbench.model.kinematics import build_vjm
from testbench.model.load import Load, resultant
from testbench.model.structure import all153, joints_only
from testbench.model.vjm import tool_pose
from testbench.output.replace import reading

ARRAYS = ("root", "L")
"""Of posterior.npz: root of the precision, (a, a), and L of the metric of the compliances in it, (e, e)."""
TURN = 1e-6  #: Most that a rotation of a file differs from one [1].
STRUCTURES = {"joints": joints_only, "links": all153}
"""Compliances that a model may have."""


def write_model(
    calibration: Calibration, data: Mapping[str, str], doubts: Sequence[str], folder: Path
) -> None:
    """Write a calibrated arm into a folder that exists; `data` has the SHA-256 of every file of readings."""
    state, own, noise = calibration.state, calibration.own, calibration.noise
    elastic, errors, columns = own.elastic, state.errors, model_of(calibration).columns
    frames = len(own.columns) - len(columns)
    kept = [step.name for step in calibration.chosen.steps if step.kept]
    vjm = own.unknowns.vjm
    loads = [resultant(tool_pose(vjm, s.q)[1], [Load(s.wrench, s.point)]) for s in calibration.series]
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
        "weights": model_folder.weights_said(state.weights),
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
        "about": model_folder.about_said(method, data, doubts, loads),
    }
    L = np.zeros((0, 0)) if elastic is None else elastic.L
    root = calibration.root[frames:, frames:]
    model_folder.write_parts(CalibrationDocument, vjm.arm, said, folder, root=root, L=L)


def read_model(folder: Path) -> ArmModel:
    """A calibrated arm from its folder; InputError where it holds none that is whole."""
    with reading(folder):
        return read_whole(folder, model_folder.read_document(folder, CalibrationDocument))


def read_whole(folder: Path, found: Document) -> ArmModel:
    """The arm of a folder whose model.json was read."""
    assert isinstance(found, CalibrationDocument)
    arm = model_folder.read_arm(folder, found, meshes=found.format > 1)
    root, L = model_folder.read_arrays(folder, found, ARRAYS)
    with model_folder.numbers_of(folder):
        if (found.about is None) != (found.format == 1):
            raise ValueError("about: expected from format 2 on")
        about = About("absolute calibration") if found.about is None else model_folder.about_of(found.about)
        return _model(found, _state(found, arm), (root, L), about)


def _state(found: CalibrationDocument, arm: Arm) -> State:
    vjm, n, joints = build_vjm(arm), arm.n_theta, arm.n_joints
    own = found.errors
    errors = JointErrors(tuple(own.orders), own.ratio, own.play, own.stiffening)
    C = check_array(np.array(found.C_theta), (n, n), "C_theta [m/N, rad/(N m)]")
    if not np.array_equal(C, C.T):
        raise ValueError("C_theta: expected a symmetric matrix")
    return State(
        vjm=vjm,
        weights=model_folder.weights_of(found.weights, arm),
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


def _model(found: CalibrationDocument, state: State, arrays: tuple[Array, Array], about: About) -> ArmModel:
    """The metric is that of the day of the calibration, whatever it has become since."""
    (root, L), rigid = arrays, found.compliances == "none"
    structure = STRUCTURES["joints" if rigid else found.compliances](state.vjm.arm)
    columns, e = np.array(found.columns, dtype=int), 0 if rigid else structure.n
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
