"""Absolute readings in, a calibrated arm out; and how far it is from readings that it never saw.

Quantities of a calibration that readings do not determine, and what they hide behind, in sentences.
"""

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeVar

import numpy as np

from testbench.arm.folder import Arm
from testbench.data.dataset import Series, select_rows
from testbench.errors import Array, BenchError, Ids, InputError, sheet_of, stem_of
from testbench.files.read_series import read_series
from testbench.identify.absolute.align import (
    LEVEL_DEVIATION,
    Misfit,
    align_all,
    deviation_from_stated,
    distance_from_known_frame,
    position_residual_lengths,
    underdetermined_reason,
    undetermined_frames,
)
from testbench.identify.absolute.choose import MassFit, fit_link_masses
from testbench.identify.absolute.fit import (
    SINGLE_COEFFICIENT_ERRORS,
    Calibration,
    CalibrationOptions,
    calibrate,
    check_row_order,
)
from testbench.identify.absolute.posterior import (
    POSES_PER_TURNED_JOINT,
    AddedInformation,
    StructuralDirections,
    fit_frame_and_mount,
    inside_ellipsoid,
    predict_series,
    register_with_known_frame,
    structural_directions,
)
from testbench.identify.absolute.state import Unknowns, nominal_state, torque_scale
from testbench.identify.diagnosis.diagnose import explain_unregistered_series
from testbench.identify.diagnosis.gravity import mounting_by_own_weight
from testbench.identify.diagnosis.hypotheses import describe
from testbench.identify.observability import (
    NamedQuantity,
    UndeterminedQuantity,
    undetermined_quantities,
)
from testbench.identify.posterior import ArmModel, Posterior
from testbench.identify.prior import cad_prior
from testbench.identify.registration import MIN_REGISTRATION_POSES, NOMINAL_TARGET_DEVIATION, Frame
from testbench.model.load import read_body_masses
from testbench.model.structure import BEAM_ENTRIES
from testbench.model.vjm import Vjm
from testbench.runs.manifest import digest
from testbench.runs.rows import Row

# --- Absolute readings in, a calibrated arm out; and how far it is from readings that it never saw ----------

T = TypeVar("T")
FRAME_POSES = 50
"""Rows that tell frame and mount of a series that the calibration has not seen, half of a short one."""
FURTHER = 50  #: Further poses of which a calibration tells what they bring.
DRIFT = 45e-6
"""How far geometry has moved along an axis and about one between two series [m, rad]: 32e-6 of each, by the
evidence of two of a UR10, four months apart, 166 nats above none. A single series tells nothing of it."""


@dataclass(frozen=True)
class Calibrated:
    """Hold a calibration and what it was made from."""

    calibration: Calibration
    notes: tuple[str, ...]  #: What was understood and assumed.
    mounting: str = ""  #: How the base seems to stand, if not as the arm's folder says, in a sentence.


@dataclass(frozen=True)
class PositionErrors:
    """Hold distances of positions from a model that never saw them."""

    n: int  #: Positions.
    mean_mm: float
    rms_mm: float
    p95_mm: float
    max_mm: float
    coverage_95: float  #: Share of the positions inside their 95 % ellipsoid [1].


@dataclass(frozen=True)
class File:
    """Describe a file of absolute readings, and how it is read."""

    path: Path
    mapping: Path | None = None  #: A map of its names; None where it uses ours.
    load: float | None = None  #: Mass that hangs in loaded rows where the file gives none [kg].
    sigma_um: float | None = None  #: Noise of a reading along an axis, where the file lacks it.


def files_of(
    paths: Sequence[Path],
    mappings: Sequence[Path] | None,
    loads: Sequence[float] | None,
    sigma_um: float | None,
) -> list[File]:
    """Pair files of readings with their maps and loads.

    Args:
        paths: Files of absolute readings.
        mappings: Their maps, one for all or one for each; None for none.
        loads: Masses that hang in loaded rows without one, the same way [kg].
        sigma_um: Noise of a reading along an axis, where a file lacks it [um].

    Returns:
        The files.

    Raises:
        BenchError: When maps or loads are neither one nor as many as the files.
    """

    def each(flag: str, given: Sequence[T] | None) -> Sequence[T | None]:
        count = len(paths)
        if given and len(given) not in (1, count):
            expected = f"expected one value, or one for each of {count} files"
            raise BenchError(f"{flag}: {expected}, got {len(given)}")
        return given if given and len(given) == count else [given[0] if given else None] * count

    both = zip(each("--map", mappings), each("--load", loads), strict=True)
    return [File(path, *own, sigma_um) for path, own in zip(paths, both, strict=True)]


def read_all(given: Sequence[File], arm: Arm) -> tuple[tuple[Series, ...], tuple[str, ...]]:
    """Read absolute readings of several files, each once and of another name.

    Args:
        given: The files.
        arm: Description of the arm.

    Returns:
        The series, and notes on what was understood.
    """
    series: list[Series] = []
    notes: list[str] = []
    for k, file in enumerate(given):
        path, name = file.path, stem_of(file.path)
        if name in (stem_of(other.path) for other in given[:k]):
            raise InputError(path, "", f"expected another name: a file called {name} was read already")
        sigma = None if file.sigma_um is None else 1e-6 * file.sigma_um
        series_export = read_series(path, arm, file.mapping, sigma, file.load)
        _check_new(path, series_export.series, series)
        series += series_export.series
        notes += [f"{path.name}: {note}" for note in series_export.notes]
    return tuple(series), tuple(notes)


def _check_new(path: Path, series: Sequence[Series], before: Sequence[Series]) -> None:
    """Refuse a file whose readings were read already: held out, they would be no news."""
    known = {reading for one in before for reading in _readings(one)}
    own = [reading for one in series for reading in _readings(one)]
    again = sum(reading in known for reading in own)
    if again > len(own) / 2:
        raise InputError(
            path, "", f"expected new readings: {again} of its {len(own)} are in another file too"
        )


def _readings(series: Series) -> list[bytes]:
    """Joints and positions of every row that was read."""
    read = series.position if series.distance is None else series.distance
    rows = np.hstack([series.q, series.wrench[:, :3], read.reshape(series.n_rows, -1)])
    return [row.tobytes() for row in rows[series.is_measured.any(axis=1)].round(9) + 0.0]


@contextmanager
def raise_explanation(vjm: Vjm) -> Iterator[None]:
    """Say what would make readings fit an arm, where they do in no frame, by BenchError."""
    try:
        yield
    except Misfit as err:
        issue = explain_unregistered_series(vjm, err.series)
        hint = ": another arm, another notation of angles or order of its joints, or other units?"
        if issue and issue.name != "kinematics" and issue.details["now"] < issue.details["was"]:
            hint = f"; {describe(issue, vjm.arm, err.series.joint_columns).sentence}"
        raise BenchError(f"{err}{hint}") from err


def kinematic_misfit(vjm: Vjm, series: Sequence[Series]) -> float:
    """Compute the median distance of readings from the rigid arm as drawn, in its best frame.

    Args:
        vjm: Kinematics of the arm.
        series: Series of absolute readings.

    Returns:
        Distance [m]; BenchError if no frame fits.
    """
    weights = read_body_masses(vjm.arm)
    with raise_explanation(vjm):
        check_row_order(vjm, series)
        state = align_all(
            nominal_state(vjm, weights, torque_scale(vjm, weights, tuple(series))), tuple(series)
        )
    left = (position_residual_lengths(state, one)[one.is_measured] for one in series)
    return float(np.median(np.concatenate(list(left))))


def calibrate_with_masses(
    vjm: Vjm, series: Sequence[Series], options: CalibrationOptions, notes: Sequence[str] = ()
) -> Calibrated:
    """Calibrate an arm, its masses by joint torques where these were read.

    Args:
        vjm: Kinematics of the arm.
        series: Series of absolute readings.
        options: What is fitted, and how.
        notes: Notes on the readings.

    Returns:
        The calibration.
    """
    weights, said = read_body_masses(vjm.arm), list(notes)
    if masses := fit_link_masses(vjm, weights, tuple(series)):
        weights = masses.body_masses
        said.append(of_masses(masses))
    with raise_explanation(vjm):
        calibration = calibrate(vjm, series, cad_prior(vjm.arm), options, weights)
    said += [
        f"{one.name}: {few}; frame and mount are taken from the series that share them"
        for one in series
        if (few := underdetermined_reason(vjm, one))
    ]
    said += of_held(calibration)
    words = (describe(issue, vjm.arm).sentence for issue in calibration.issues)
    mounted = mounting_by_own_weight(calibration.state, calibration.series, cad_prior(vjm.arm))
    return Calibrated(
        calibration,
        (*said, *words),
        describe(mounted, vjm.arm).sentence if mounted else "",
    )


def hidden_geometry(calibrated: Calibrated) -> str:
    """Say what geometry that no arm has may hide, such as a joint's zero."""
    why = explain_unregistered_series(calibrated.calibration.state.vjm, calibrated.calibration.series[0])
    if why is None or why.name == "kinematics":
        return "is the zero of a joint wrong, or is it another arm?"
    return describe(
        why, calibrated.calibration.state.vjm.arm, calibrated.calibration.series[0].joint_columns
    ).sentence


BY_ANOTHER_SERIES = "another series with the same target or frame determines it"
BY_PRIOR = {
    "mount": (
        "its tool turns too little, so the places of its targets on the tool and of the frame cannot be "
        "separated",
        f"a prior holds the targets where the arm's folder has them, else at the tool, within "
        f"{1e3 * NOMINAL_TARGET_DEVIATION:.0f} mm; predictions of other orientations depend on it",
    ),
    "frame": (
        "a turn of its frame about the line of its positions is not determined",
        f"a prior holds the frame upright, within {np.degrees(LEVEL_DEVIATION):.1f} degrees",
    ),
}
"""What readings do not determine, and what then holds it."""


def of_held(calibration: Calibration) -> list[str]:
    """Say what every series leaves open of its frame and mount, and what holds it."""
    every = calibration.active_unknowns.unknowns.undetermined_frames
    words = []
    for series in calibration.series:
        if series.distance is not None:
            words.append(f"{series.name}: {_found_place(series, calibration.state.frame(series))}")
        alone = undetermined_frames(calibration.state.vjm, (series,))
        for key, (open_, held) in BY_PRIOR.items():
            name = f"{key} {getattr(series, key)}"
            if name in alone:
                words.append(f"{series.name}: {open_}: {held if name in every else BY_ANOTHER_SERIES}")
    return words


def _found_place(series: Series, frame: Frame) -> str:
    """Say where the fixed point or plane of distances was found, and what they do not determine."""
    off, turn, found = deviation_from_stated(series, frame)
    place = f"found at {', '.join(f'{x:.4f}' for x in found)} m, {1e3 * off:.1f} mm"
    if series.plane_normal is not None:
        return (
            f"its plane is {place} and {np.degrees(turn):.2f} deg from where it is stated; these heights "
            "alone do not determine the base along this plane, nor its turn about the normal"
        )
    constant = f"{1e3 * frame.distance_offset:.3f} mm are subtracted from its distances; "
    return (
        f"its fixed point is {place} from where it is stated; "
        f"{constant if series.distance_offset_sigma else ''}these distances alone do not determine the turn "
        "of the base about this point"
    )


def of_masses(mass_fit: MassFit) -> str:
    """Say where masses from torques come from."""
    if not mass_fit.explains_torques:
        return (
            "the masses of rigid.xml are used, because fitted masses do not explain the torques: "
            f"the residual is {mass_fit.residual:.3g} N m, the standard deviation of the torques is "
            f"{mass_fit.torque_deviation:.3g} N m. Check the order of joints, the unit and the payload"
        )
    whose = "motors against the weight" if mass_fit.are_motor_torques else "weight on the joints"
    return (
        f"masses are fitted to the torques of {mass_fit.n_poses} poses, taken as the torques of the {whose}; "
        f"standard deviation of these torques: {mass_fit.torque_deviation:.3g} N m; "
        f"unexplained with the fitted masses: {mass_fit.residual:.3g} N m; "
        f"unexplained with the masses of rigid.xml: {mass_fit.nominal_residual:.3g} N m; bodies that differ "
        f"from rigid.xml by the largest allowed amount: {', '.join(mass_fit.bodies_at_bound) or 'none'}"
    )


def evenly_spaced_rows(series: Series, poses: int) -> Ids:
    """Select the rows of evenly spaced poses, of those that were read.

    Args:
        series: A series of absolute readings.
        poses: Number of poses.

    Returns:
        Indices of the rows.
    """
    seen = np.flatnonzero(series.is_measured.any(axis=1))
    pose = series.pose_id[seen]
    every = pose[np.sort(np.unique(pose, return_index=True)[1])]  # in the order in which they came
    if len(every) < poses or poses < MIN_REGISTRATION_POSES:
        raise BenchError(
            f"{series.name}: expected at least {max(MIN_REGISTRATION_POSES, poses)} poses for its frame and "
            f"target, got {min(len(every), poses)}"
        )
    kept = every[np.unique(np.linspace(0, len(every) - 1, poses).round().astype(int))]
    return np.asarray(seen[np.isin(pose, kept)])


def with_drift(model: ArmModel) -> ArmModel:
    """Widen a model to how sure it is of the arm when another series is read."""
    posterior, geometry = (
        model.posterior,
        np.flatnonzero(model.uncertain_columns < model.unknowns.first_columns["errors"]),
    )
    moved = np.zeros((len(geometry), len(posterior.mean)))
    moved[np.arange(len(geometry)), geometry] = DRIFT
    return replace(
        model,
        posterior=Posterior.from_covariance_root(
            posterior.mean, np.vstack([posterior.covariance_root, moved])
        ),
    )


def score(
    model: ArmModel, files: Sequence[File], frame_poses: int | None
) -> tuple[PositionErrors, tuple[str, ...]]:
    """Compute how far files of readings are from a calibrated arm, see `position_errors`.

    Args:
        model: The model.
        files: Files of absolute readings.
        frame_poses: Poses that tell frame and mount; None as there.

    Returns:
        The distances, and how the files were read.
    """
    series, notes = read_all(files, model.arm)
    if any(digest(sheet_of(file.path)[0]) in model.origin.file_hashes.values() for file in files):
        notes += ("these readings were fitted: only other readings can validate the model",)
    return position_errors(model, series, frame_poses), notes


def position_errors(model: ArmModel, series: Sequence[Series], frame_poses: int | None) -> PositionErrors:
    """Compute how far readings are from a calibrated arm.

    So many poses of each series tell its frame and mount, and are not counted; if not said, those of the
    calibration count where it has them, else FRAME_POSES poses do; geometry may have moved by DRIFT then.

    Args:
        model: The model.
        series: Series of absolute readings.
        frame_poses: Poses that tell frame and mount; None as above.

    Returns:
        The distances.
    """
    (far, within), state = ([], []), model.state
    for one in series:
        mount = state.mounts.get(one.mount)
        seen_before = one.frame in state.frames and mount is not None and {*one.markers} <= {*mount.markers}
        if frame_poses is None and seen_before:
            if off := distance_from_known_frame(state, one):
                raise BenchError(
                    f"{one.name}: three quarters of its readings are {1e3 * off:.4g} mm or more from the "
                    f"positions that the calibration predicts in frame {one.frame!r}; did the tracker move? "
                    "--frame-poses fits a new frame"
                )
            placed = register_with_known_frame(model, one)
        else:
            some = frame_poses or min(
                FRAME_POSES, max(MIN_REGISTRATION_POSES, len(np.unique(one.pose_id)) // 2)
            )
            with raise_explanation(model.state.vjm):
                placed = fit_frame_and_mount(with_drift(model), one, evenly_spaced_rows(one, some))
        rest = select_rows(one, np.setdiff1d(np.arange(one.n_rows), placed.rows_of_frame_fit))
        if not rest.n_rows:
            used = f"all {len(placed.rows_of_frame_fit)} rows are used to fit its frame"
            raise BenchError(f"{one.name}: {used}, so none validates the model")
        left, covariance = predict_series(model, placed, rest)
        far.append(1e3 * np.linalg.norm(left, axis=2)[rest.is_measured])
        within.append(inside_ellipsoid(left, covariance, one.chi_squared_95)[rest.is_measured])
    return PositionErrors(
        **distance_statistics(np.concatenate(far)), coverage_95=float(np.concatenate(within).mean())
    )


def distance_statistics(mm: Array) -> Row:
    """Summarise distances of positions, (n,) [mm], as every report has them."""
    rms, p95 = float(np.sqrt((mm**2).mean())), float(np.percentile(mm, 95))
    return Row(n=len(mm), mean_mm=float(mm.mean()), rms_mm=rms, p95_mm=p95, max_mm=float(mm.max()))


# --- Quantities of a calibration that readings do not determine, and what they hide behind, in sentences ----

FREE_DEVIATION = 0.01
"""Standard deviation of what has no prior, frames and mounts [m, rad]: much more than readings leave of it,
and not so much that rounding would hide the rest."""
SINGLE = {kind: name for name, kind in SINGLE_COEFFICIENT_ERRORS.items()}
STRETCH, TWIST, BENDING, COUPLING = "stretch", "torsion", "bending", "coupling that beams lack"
OWNER = "'s "  #: Between a joint or link and what it has.
ERROR = f"{OWNER}error of order "  #: Between a joint and the orders of its periodic errors.


def unobservable(
    unknowns: Unknowns, information: Array, prior: Array, further: AddedInformation
) -> tuple[str, ...]:
    """Say what readings leave unknown of a calibration, in few sentences.

    Args:
        unknowns: Whose columns they are.
        information: Of the readings, no prior, (size, size).
        prior: Covariance, (size, size), zero of what is taken to be zero.
        further: What further poses would tell, `further_information`.

    Returns:
        The sentences.
    """
    on, L = np.flatnonzero(np.diag(prior)), np.zeros_like(prior)
    L[np.ix_(on, on)] = np.linalg.cholesky(prior[np.ix_(on, on)])
    every = structural_directions(unknowns, L, further)
    every_one = (information, *further.by_turned_joint, further.whole_joint_space)
    M, *more = (np.asarray(L.T @ one @ L) for one in every_one)
    found = undetermined_quantities(quantities(unknowns), L, M, every.directions, more)
    names = [joint.name for joint in unknowns.vjm.arm.joints]
    return (*structure_words(every, names, unknowns.structure.n_parameters), *sentences(found, names))


def structure_words(found: StructuralDirections, joints: Sequence[str], compliances: int) -> Iterator[str]:
    """Say what no pose could show.

    Args:
        found: Directions that no pose shows.
        joints: Names of the joints.
        compliances: Number of directions of compliances.

    Yields:
        Sentences.
    """
    if found.n_geometry:
        yield (
            f"{found.n_geometry} directions of geometry, frames and mounts cannot be determined by any pose, "
            "because they move no target. A turn about a joint's axis, or a shift along it, may belong to "
            "the link before or after it"
        )
    if found.inactive_joints:
        idle = " and ".join(joints[j] for j in found.inactive_joints)
        yield f"No pose can determine the joint errors of {idle}, because they move no target"
    if found.n_compliance:
        yield (
            f"{found.n_compliance} of {compliances} directions of compliance cannot be determined by any "
            "pose, because they move no target under these loads"
        )


def sentences(found: Sequence[UndeterminedQuantity], joints: Sequence[str]) -> tuple[str, ...]:
    """Write what is not seen: what nothing explains in one sentence per advice, else one per quantity.

    Errors of a joint that hide behind others of the same joint share a sentence.

    Args:
        found: Hidden quantities.
        joints: Names of the joints.

    Returns:
        The sentences.
    """
    groups: dict[tuple[str, int | None], list[UndeterminedQuantity]] = {}
    for hidden in found:
        joint = hidden.name.partition(ERROR)[0]
        own_errors = {name.partition(ERROR)[0] for name in hidden.confounded_with} == {joint}
        subject = (joint if own_errors else hidden.name) if hidden.confounded_with else ""
        groups.setdefault((subject, hidden.joint_to_turn), []).append(hidden)
    return tuple(_sentence(own, joints) for own in groups.values())


def _sentence(own: Sequence[UndeterminedQuantity], joints: Sequence[str]) -> str:
    """Describe quantities that hide alike, and how to see them."""
    names = _listed(hidden.name for hidden in own)
    shares = _range_text([100 * hidden.remaining_variance_share for hidden in own], 0)
    left = f"{shares} % of the prior variance remains"
    if behind := [name for hidden in own for name in hidden.confounded_with]:
        correlation = _range_text([hidden.multiple_correlation for hidden in own], 2)
        apart = f"{names} cannot be separated from {_listed(behind)}"
        if len(own) > 1:  # errors of one joint
            every = _listed([*(hidden.name for hidden in own), *behind])
            apart = f"{every} cannot be separated from each other"
        words = f"{apart} (correlation {correlation}, {left})"
    else:
        words = f"{names} {'is' if len(own) == 1 else 'are'} not determined ({left})"
    turn = own[0].joint_to_turn
    if turn is None:
        return words
    if turn < 0:
        return f"{words}: {POSES_PER_TURNED_JOINT} more poses hardly help; another load may help"
    return f"{words}: turn {f'{joints[turn]} more' if turn < len(joints) else 'several joints together'}"


def _listed(names: Iterable[str]) -> str:
    """List quantities: periodic errors of a joint as one, and what several parts have once, with these."""
    orders: dict[str, list[str]] = {}
    for name in dict.fromkeys(names):
        owner, _, order = name.partition(ERROR)
        orders.setdefault(owner, []).extend([order] if order else [])
    owners: dict[str, list[str]] = {}
    for name, own in orders.items():
        owner, _, what = name.partition(OWNER)
        if own:
            told = ", ".join(sorted(own, key=lambda order: int(order.split()[0])))
            what = f"errors of orders {told}" if len(own) > 1 else f"error of order {told}"
        owners.setdefault(what, []).append(owner)
    listed = owners.pop("", [])
    for what, parts in owners.items():
        several = f"{what.replace('error of', 'errors of')} ({', '.join(parts)})"
        listed.append(several if len(parts) > 1 else f"{parts[0]}{OWNER}{what}")
    return ", ".join(listed)


def _range_text(numbers: Sequence[float], digits: int) -> str:
    ends = f"{min(numbers):.{digits}f}", f"{max(numbers):.{digits}f}"
    return " to ".join(dict.fromkeys(ends))


def quantities(unknowns: Unknowns) -> tuple[NamedQuantity, ...]:
    """List all quantities, in the order of the columns."""
    return (*_set_ups(unknowns), *_lengths(unknowns), *_bands(unknowns), *_springs(unknowns))


def _of(unknowns: Unknowns, name: str, columns: Ids) -> NamedQuantity:
    """One whose numbers are columns themselves."""
    return NamedQuantity(name, np.eye(unknowns.size)[columns])


def _set_ups(unknowns: Unknowns) -> Iterator[NamedQuantity]:
    every = np.eye(unknowns.size)
    keys = [*(("frame", name) for name in unknowns.frames), *(("mount", name) for name in unknowns.mounts)]
    for kind, name in keys:
        columns = np.arange(unknowns.size)[unknowns.columns(f"{kind} {name}")]
        own = np.setdiff1d(columns, unknowns.unused_rotations)
        rows, words = every[own], f"the {kind} of {name}"
        if kind == "frame" and name in unknowns.plane_normals:
            # Planes show shifts along their normals, and turns about the axes across these.
            words, normals = f"the plane of {name}", np.array(unknowns.plane_normals[name])
            across = np.concatenate([np.linalg.svd(normal[None])[2][1:] for normal in normals])
            rows = np.concatenate([_span(normals) @ rows[:3], _span(across) @ rows[3:]])
        elif kind == "frame" and name in unknowns.frame_deviations:
            words = f"the fixed point of {name}"
        yield NamedQuantity(words, rows, belongs_to_arm=False)


def _span(vectors: Array) -> Array:
    """Find an orthonormal basis of what some vectors, (k, 3), span."""
    _, size, basis = np.linalg.svd(vectors)
    return np.asarray(basis[: int((size > 1e-6).sum())])  # of unit vectors; a turn of 1e-6 rad is none


def _lengths(unknowns: Unknowns) -> Iterator[NamedQuantity]:
    """Of every inner link the offset of the joint behind it, its other turns and its shifts."""
    arm, first = unknowns.vjm.arm, unknowns.first_columns["geometry"]
    for k in range(1, arm.n_joints):
        link = arm.links[k].name
        joint = arm.joints[k]
        axis = unknowns.vjm.joint_axes_in_beam_frame[k]
        own = np.eye(unknowns.size)[first + 6 * (k - 1) + np.arange(6)]
        shift, turn = own[:3], own[3:]
        across = np.linalg.svd(axis[None])[2][1:]  # two axes at right angles to the joint's
        along, other = (shift, turn) if joint.prismatic else (turn, shift)
        kinds = ("shift", "turn") if joint.prismatic else ("turn", "shift")
        yield NamedQuantity(f"{joint.name}'s offset", axis[None] @ along)
        yield NamedQuantity(f"{link}'s {kinds[0]}", across @ along)
        yield NamedQuantity(f"{link}'s {kinds[1]}", other)


def _bands(unknowns: Unknowns) -> Iterator[NamedQuantity]:
    errors, first = unknowns.error_terms, unknowns.first_columns["errors"]
    orders = np.tile(errors.orders, 2)
    kinds, bands = np.array(errors.coefficient_kinds), errors.coefficient_bands
    for j, joint in enumerate(unknowns.vjm.arm.joints):
        own = first + j * errors.n_coefficients
        for band in np.unique(bands[bands >= 0]) if not joint.prismatic else ():
            at = np.flatnonzero(bands == band)
            low, high = orders[at].min(), orders[at].max()
            name = f"{joint.name}{ERROR}{low}" if low == high else f"{joint.name}{ERROR}{low} to {high}"
            yield _of(unknowns, name, own + at)
        for kind in kinds[bands < 0]:
            name = f"{joint.name}'s {SINGLE[kind]}"
            yield _of(unknowns, name, own + np.flatnonzero(kinds == kind))


def _springs(unknowns: Unknowns) -> Iterator[NamedQuantity]:
    arm = unknowns.vjm.arm
    structure = unknowns.structure
    first = unknowns.first_columns["elastic"]
    links = 6 * len(arm.links)
    kind = np.array([_kind(a % 6, b % 6) for a, b in zip(structure.rows, structure.columns, strict=True)])
    for k, link in enumerate(arm.links):
        for name in (STRETCH, TWIST, BENDING, COUPLING):
            own = np.flatnonzero((structure.rows // 6 == k) & (structure.rows < links) & (kind == name))
            if len(own):
                yield _of(unknowns, f"{link.name}'s {name}", first + own)
    for k in np.flatnonzero(structure.rows >= links).tolist():
        name = arm.joints[structure.rows[k] - links].name
        yield _of(unknowns, f"{name}'s compliance", first + np.array([k]))


def _kind(a: int, b: int) -> str:
    """What an entry of a link's compliance stands for."""
    a, b = min(a, b), max(a, b)
    if (a, b) not in BEAM_ENTRIES:
        return COUPLING
    return {(0, 0): STRETCH, (3, 3): TWIST}.get((a, b), BENDING)
