"""Models of an arm as folders, written and read: stiffness of `testbench identify`, arms of `calibrate`.

A folder has the files of the arm, model.json, which is a `Document`, and posterior.npz, the arrays of ARRAYS.
"""

import io
import math
import shutil
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, JsonValue, ValidationError

from testbench.arm.document import StrictModel, text_matching
from testbench.arm.folder import Arm, find_arm, load_arm
from testbench.arm.mjcf import MAX_MESH_BYTES
from testbench.data.dataset import Dataset, Series
from testbench.errors import (
    Array,
    BenchError,
    InputError,
    check_array,
    check_type,
    open_file,
    read_bytes,
    read_text,
)
from testbench.identify.absolute.align import EQUATION_KINDS, Noise
from testbench.identify.absolute.state import ArmState, Mount, Unknowns
from testbench.identify.posterior import ArmModel, ModelOrigin, Posterior
from testbench.identify.registration import Frame
from testbench.model.kinematics import JointErrorTerms, build_vjm
from testbench.model.laws import COMPENSATOR_KIND, add_law_parameters, joint_laws, vjm_for_structure
from testbench.model.load import BodyMasses, Load, resultant_wrench
from testbench.model.structure import Structure, all153, theta_row_labels
from testbench.model.vjm import Vjm, tool_poses
from testbench.runs import manifest as files
from testbench.runs.manifest import ARM_FILES, DOCUMENT, MAX_ROOT, POSTERIOR, arm_files, input_error
from testbench.runs.rows import finite
from testbench.runs.whole import reading, whole_folder

FITS = "models.json"  #: All fits of `testbench identify`, beside the recommended one.
MAX_BYTES = 50_000_000  #: Largest model.json [byte].
FORMAT = 3  #: Of what is written; no other one is read.
ARRAYS = ("root", "unseen", "scale")
"""Names in posterior.npz of root, unobservable rows and scale of a `Posterior`."""
MAX_MODEL_NUMBER = 1e12  #: Of a model's numbers, whatever the unit: squares of products of them are finite.
MAX_TEXT, MAX_NAME_LENGTH = 20_000, 255
"""Longest text of a model, and longest name of its arm [characters]."""
MAX_LIST = 100_000  #: Numbers of a list.
PRINTED = text_matching("[^\\x00-\\x1f\\x7f-\\x9f\\u2028\\u2029]*", "no control characters")
"""A text that XML can hold."""
Number = Annotated[float, Field(ge=-MAX_MODEL_NUMBER, le=MAX_MODEL_NUMBER)]
Size = Annotated[float, Field(ge=0, le=MAX_MODEL_NUMBER)]
Factor = Annotated[float, Field(gt=0, le=MAX_MODEL_NUMBER)]
Count = Annotated[int, Field(ge=0, le=MAX_LIST)]
Numbers = Annotated[list[Number], Field(max_length=MAX_LIST)]
Rows = Annotated[list[Numbers], Field(max_length=MAX_LIST)]
Texts = Annotated[list[str], Field(max_length=1000)]


class ModelPart(StrictModel):
    """Describe a part of model.json, perhaps a stranger's: no text of it fills a page."""

    model_config = ConfigDict(str_max_length=MAX_TEXT)


class AboutPart(ModelPart):
    """Say where a model comes from."""

    method: str
    #: SHA-256 of every file of readings, by its name.
    data: Annotated[dict[str, str], Field(max_length=1000)]
    doubts: Texts
    force_N: Size | None
    moment_Nm: Size | None
    versions: dict[str, str]


class ComplianceEntry(ModelPart):
    """Name an entry of C_theta, and of its mirror in a symmetric one [m/N, rad/(N m), rad/N]."""

    row: str  #: Link and axis, such as link_2.phi_x, or a joint.
    column: str
    value: Number


class StructurePart(ModelPart):
    """List which compliances were unknown, and what they are."""

    name: str
    symmetric: bool
    entries: Annotated[list[ComplianceEntry], Field(min_length=1)]


class WeightsPart(ModelPart):
    """Hold masses and centres of all bodies."""

    mass_kg: list[Size]
    centre_m: Rows


class ErrorsPart(ModelPart):
    """Hold errors of the joints, one row of coefficients per joint."""

    orders: list[Count]
    ratio: bool
    play: bool
    stiffening: bool
    coefficients: Rows
    torque_scale: list[Size]


class NoisePart(ModelPart):
    """Hold how far readings scatter; factors of every kind of equations."""

    open_position_m: Size
    open_rotation_rad: Size
    factor: list[Factor]


class FramePart(ModelPart):
    """Place the base in a tracker's frame."""

    rotation: Rows
    translation_m: Numbers
    zero_m: float = 0.0


class MountPart(ModelPart):
    """Place targets on the tool, by name."""

    markers: list[str]
    points_m: Rows
    rotation: Rows


class SpreadPart(ModelPart):
    """Describe the distribution in posterior.npz."""

    #: Of Student's distribution; null for the normal one.
    degrees_of_freedom: Factor | None
    heavy_rows: Count  #: Last rows of root that are the prior's, of Student's.
    pull: Size
    on_boundary: bool


class Document(ModelPart):
    """Hold model.json; docs/formats.md says what each key holds."""

    format: int
    name: str  #: Of the model, such as ALL153 + prior.
    arm: Annotated[str, Field(max_length=MAX_NAME_LENGTH), PRINTED]
    about: AboutPart
    structure: StructurePart
    weights: WeightsPart
    theta_0: Numbers
    errors: ErrorsPart
    noise: NoisePart | None  #: Null where deflections alone were read.
    frames: dict[str, FramePart]
    mounts: dict[str, MountPart]
    columns: list[Count]
    spread: SpreadPart
    fit: dict[str, JsonValue]  #: For people: nothing is computed from it.


class Head(BaseModel):
    """Hold what tells one format from another."""

    format: int


def load_model(folder: str | Path, arm: str | Path | None = None) -> ArmModel:
    """Read a model that `testbench identify` or `testbench calibrate` wrote.

    Args:
        folder: Holds model.json, posterior.npz and the arm's files.
        arm: Folder of the arm that it must be a model of, or the name of one that comes with testbench; None
            for any.

    Returns:
        The arm as it was identified.

    Raises:
        InputError: When the folder holds none, one of another version, or one of another arm.
    """
    folder = Path(folder)
    with reading(folder):
        document = _read_document(folder)
        if arm is not None:
            _check_arm(folder, document, find_arm(arm))
        own = replace(load_arm(folder), name=document.arm)
        arrays = _read_arrays(folder / POSTERIOR)
        try:
            return _model(document, own, arrays)
        except InputError:
            raise
        except (BenchError, ValueError, IndexError) as err:
            raise InputError(
                folder / DOCUMENT, "", f"the numbers of this model contradict each other: {err}"
            ) from err


def read_model(folder: Path) -> ArmModel:
    """Read a calibrated arm from its folder; InputError where it holds none."""
    model = load_model(folder)
    if not model.is_absolute:
        problem = "expected a model of testbench calibrate, got one of testbench identify"
        raise InputError(folder / DOCUMENT, "noise", problem)
    return model


def _read_document(folder: Path) -> Document:
    path = folder / DOCUMENT
    if not path.is_file():
        problem = f"expected the folder of a model that identify or calibrate wrote, with {DOCUMENT}"
        raise InputError(folder, "", problem)
    text = read_text(path, MAX_BYTES)
    try:
        head = Head.model_validate_json(text)
        if head.format != FORMAT:
            problem = f"this version reads format {FORMAT}, the model has format {head.format}: fit it again"
            raise InputError(path, "format", problem)
        return Document.model_validate_json(text)
    except ValidationError as err:
        raise input_error(path, err) from err


def _check_arm(folder: Path, document: Document, place: Path) -> None:
    for name in ARM_FILES:
        path, other = folder / name, place / name
        if not other.is_file() or files.digest(path) != files.digest(other):
            problem = f"the model is of another arm, {document.arm}: its {name} differs from that of {place}"
            raise InputError(folder, "", problem)


def _read_arrays(path: Path) -> dict[str, Array]:
    """Arrays of posterior.npz by name; InputError where it is none, or too large."""
    raw = io.BytesIO(read_bytes(path, MAX_ROOT))
    try:
        with zipfile.ZipFile(raw) as packed:
            size = sum(entry.file_size for entry in packed.infolist())
        if size > MAX_ROOT:
            raise BenchError(f"at most {MAX_ROOT} bytes when unpacked, got {size}")
        with np.load(raw, allow_pickle=False) as data:
            return {name: data[name] for name in ARRAYS}
    except (
        Exception
    ) as err:  # of bytes that are no such file numpy, zipfile and lzma raise errors of 15 kinds
        raise InputError(path, "", f"expected the posterior of a model: {err}") from err


def _model(document: Document, arm: Arm, arrays: Mapping[str, Array]) -> ArmModel:
    """The model; BenchError, ValueError or IndexError where numbers do not belong together."""
    structure, spread = _structure(document.structure, arm), document.spread
    state = _state(document, vjm_for_structure(build_vjm(arm), structure), structure)
    said = document.about
    noise = document.noise
    scatter = None
    origin = ModelOrigin(said.method, said.data, tuple(said.doubts), said.force_N, said.moment_Nm)
    if noise is not None:
        factor = check_array(noise.factor, (len(EQUATION_KINDS),), "factor")
        scatter = Noise(noise.open_position_m, noise.open_rotation_rad, factor)
    columns = np.array(document.columns, dtype=int)
    n, unknowns = len(columns), Unknowns(state.vjm, (), {}, state.error_terms, structure)
    posterior = Posterior(
        mean=unknowns.values(state)[columns],
        covariance_root=check_array(arrays["root"], (None, n), "root"),
        unobservable_directions=check_array(arrays["unseen"], (None, n), "unseen"),
        typical_sizes=check_array(arrays["scale"], (n,), "scale"),
        student_dof=math.inf if spread.degrees_of_freedom is None else spread.degrees_of_freedom,
        cone_distance=spread.pull,
        on_cone_boundary=spread.on_boundary,
        n_prior_rows=spread.heavy_rows,
    )
    return ArmModel(state, structure, columns, posterior, origin, scatter)


def _structure(said: StructurePart, arm: Arm) -> Structure:
    plain, joints = theta_row_labels(arm), [joint.name for joint in arm.joints]
    rows = [entry.row.rpartition(" ") for entry in said.entries if entry.row not in plain]
    kinds = [*dict.fromkeys(kind for joint, _, kind in rows if joint in joints and kind != COMPENSATOR_KIND)]
    if unlike := [kind for kind in kinds if kind not in joint_laws]:
        raise ValueError(f"structure.entries: no joint law {unlike[0]!r}; install the package that has it")
    lawful = add_law_parameters(all153(arm), arm, kinds)
    place = {label: k for k, label in enumerate(lawful.row_labels)}
    names = {name for entry in said.entries for name in (entry.row, entry.column)}
    if unknown := sorted(names - set(place)):
        raise ValueError(f"structure.entries: {arm.name} has no {unknown[0]!r}")
    a, b = np.array([(place[entry.row], place[entry.column]) for entry in said.entries]).T
    if b.max() < arm.n_theta:
        return Structure(said.name, arm.n_theta, a, b, theta_row_labels(arm), said.symmetric)
    return Structure(said.name, lawful.n_theta, a, b, lawful.row_labels, said.symmetric, lawful.n_laws)


def _state(document: Document, vjm: Vjm, structure: Structure) -> ArmState:
    arm, said = vjm.arm, document.errors
    errors = JointErrorTerms(tuple(said.orders), said.ratio, said.play, said.stiffening)
    joints, bodies = arm.n_joints, arm.n_joints + 2
    coefficients = np.array(said.coefficients).reshape(len(said.coefficients), errors.n_coefficients)
    return ArmState(
        vjm=vjm,
        body_masses=BodyMasses(
            check_array(document.weights.mass_kg, (bodies,), "mass [kg]"),
            check_array(document.weights.centre_m, (bodies, 3), "centre [m]"),
        ),
        theta_0=check_array(document.theta_0, (structure.n_theta,), "theta_0 [m, rad]"),
        C_theta=structure.C_theta_of(np.array([entry.value for entry in document.structure.entries])),
        error_terms=errors,
        error_coefficients=check_array(coefficients, (joints, errors.n_coefficients), "errors"),
        torque_scale=check_array(said.torque_scale, (joints,), "torque_scale [N m, N]"),
        frames={
            name: Frame(
                check_array(frame_part.rotation, (3, 3), f"frame {name}"),
                check_array(frame_part.translation_m, (3,), f"frame {name} [m]"),
                distance_offset=frame_part.zero_m,
            )
            for name, frame_part in document.frames.items()
        },
        mounts={
            name: Mount(
                check_array(mount_part.points_m, (len(mount_part.markers), 3), f"mount {name} [m]"),
                check_array(mount_part.rotation, (3, 3), f"mount {name}"),
                tuple(mount_part.markers),
            )
            for name, mount_part in document.mounts.items()
        },
    )


def save_model(model: ArmModel, folder: str | Path) -> None:
    """Write a model as a folder that `load_model` and every command read: the arm's files and the posterior.

    Args:
        model: The identified arm.
        folder: Where to. An earlier model there is replaced once the new one is whole.

    Raises:
        BenchError: When model is no ArmModel.
        InputError: When the folder cannot be written.
    """
    check_type(model, ArmModel, "model")
    with whole_folder(Path(folder)) as made:
        write_files(model, made, name=model.origin.method, fit={})


def write_files(model: ArmModel, folder: Path, *, name: str, fit: Mapping[str, object]) -> None:
    """Write a model's files into a folder that exists: those of the arm, model.json and posterior.npz.

    Args:
        model: The identified arm.
        folder: Where to.
        name: Name of the model, such as ALL153 + prior.
        fit: More about the fit for people, as plain data; nothing is computed from it.
    """
    document = {"format": FORMAT, "name": name, **_document(model), "fit": fit}
    copy_arm(model.arm, folder)
    files.write_json(Document.model_validate(document).model_dump(), folder / DOCUMENT)
    posterior = model.posterior
    arrays = dict(
        zip(
            ARRAYS,
            (posterior.covariance_root, posterior.unobservable_directions, posterior.typical_sizes),
            strict=True,
        )
    )
    np.savez_compressed(folder / POSTERIOR, **arrays)  # type: ignore[arg-type]


def _document(model: ArmModel) -> dict[str, object]:
    """Collect what model.json says of a model, as plain data."""
    state = model.state
    posterior = model.posterior
    noise = model.noise
    return {
        "arm": model.arm.name,
        "about": _origin_document(model.origin),
        "structure": _structure_document(model.structure, state.C_theta),
        "weights": {
            "mass_kg": state.body_masses.mass.tolist(),
            "centre_m": state.body_masses.centre_of_mass.tolist(),
        },
        "theta_0": state.theta_0.tolist(),
        "errors": {
            **vars(state.error_terms),
            "orders": list(state.error_terms.orders),
            "coefficients": state.error_coefficients.tolist(),
            "torque_scale": state.torque_scale.tolist(),
        },
        "noise": None
        if noise is None
        else {
            "open_position_m": float(noise.position_model_error),
            "open_rotation_rad": float(noise.rotation_model_error),
            "factor": noise.factor.tolist(),
        },
        "frames": {
            name: {
                "rotation": frame.rotation.tolist(),
                "translation_m": frame.translation.tolist(),
                "zero_m": frame.distance_offset,
            }
            for name, frame in state.frames.items()
        },
        "mounts": {
            name: {
                "markers": list(mount.markers),
                "points_m": mount.points.tolist(),
                "rotation": mount.rotation.tolist(),
            }
            for name, mount in state.mounts.items()
        },
        "columns": model.uncertain_columns.tolist(),
        "spread": {
            "degrees_of_freedom": finite(posterior.student_dof),
            "heavy_rows": posterior.n_prior_rows,
            "pull": posterior.cone_distance,
            "on_boundary": posterior.on_cone_boundary,
        },
    }


def _origin_document(origin: ModelOrigin) -> dict[str, object]:
    return {
        "method": origin.method,
        "data": dict(origin.file_hashes),
        "doubts": list(origin.warnings),
        "force_N": origin.largest_force,
        "moment_Nm": origin.largest_moment,
        "versions": files.versions(),
    }


def _structure_document(structure: Structure, C_theta: Array) -> dict[str, object]:
    values = structure.parameters_of(C_theta).tolist()
    entries = [
        {"row": structure.row_labels[a], "column": structure.row_labels[b], "value": value}
        for a, b, value in zip(structure.rows, structure.columns, values, strict=True)
    ]
    return {"name": structure.name, "symmetric": structure.symmetric, "entries": entries}


def copy_arm(arm: Arm, folder: Path) -> None:
    """Copy the files of an arm with its meshes.

    Args:
        arm: The arm.
        folder: Folder to copy to.
    """
    path = arm.mjcf_path.parent
    for name in arm_files(path):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        with open_file(path / name, MAX_MESH_BYTES) as source, (folder / name).open("wb") as copy:
            shutil.copyfileobj(source, copy)


def origin_of(method: str, data: Mapping[str, str], doubts: Sequence[str], loads: Array) -> ModelOrigin:
    """Describe where a model comes from.

    Args:
        method: Method that found it.
        data: SHA-256 of every file of readings, by name.
        doubts: Warnings that go with the model.
        loads: Loads of the readings about the tool's origin, (rows, 6) [N, N m].

    Returns:
        The origin, with the largest force and moment.
    """
    force, moment = np.linalg.norm(loads.reshape(-1, 2, 3), axis=2).max(axis=0).tolist()
    return ModelOrigin(method, data, tuple(doubts), force, moment)


def loads_about_tool(vjm: Vjm, data: Dataset | Series) -> Array:
    """Compute the load of every run or row about the tool's origin.

    Args:
        vjm: Kinematics of the arm.
        data: Measured runs, or a series of absolute readings.

    Returns:
        Force and moment, world axes, (rows, 6) [N, N m].
    """
    return resultant_wrench(tool_poses(vjm, data.q)[1], [Load(data.wrench, data.point)])
