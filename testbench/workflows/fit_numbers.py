"""Numbers of fits to a user's runs: residuals, half widths over the workspace, what the runs tell."""

from collections.abc import Mapping, Sequence

import numpy as np

from testbench.correct.predicted import predict
from testbench.data.dataset import Dataset
from testbench.errors import Array, NoEquilibrium, PoseError
from testbench.identify.estimate import all_deflections
from testbench.identify.prior import Strength, cad_prior
from testbench.model.joint_laws import STRUT, joint_laws
from testbench.model.load import Load
from testbench.model.vjm import tool_pose
from testbench.plant.tracker import trial_rng
from testbench.runs.rows import Row, finite
from testbench.workflows.cell import Cell, clear_poses
from testbench.workflows.fit_details import fit_details
from testbench.workflows.fits import IdentifyResult
from testbench.workflows.identifiability import (
    DECIDED,
    Identifiability,
    explained_variance,
    of_regression,
    unseen_poses,
)
from testbench.workflows.models import JOINTS
from testbench.workflows.rows import MM, UM
from testbench.workflows.workspace_errors import Meaning, bounded_mm, error_places, kept_mm, places_at

PLACES = 200  #: Poses over the workspace.
USUAL = Strength(0.3)  #: Of the prior that readings are compared with.
COUNTS = "noise and the prior count, not what a model leaves out: joint stiffness only looks too sure"
"""What every interval of a model is told with."""
HALF_WIDTH = Meaning(
    "half width",
    f"of the 95 % interval of the tool's deflection, along the axis where it is widest; {COUNTS}",
    "median",
)
OF_MODEL = (
    "name structure constraint prior learnt method status parameters rank conservative f_m f_m_floor "
    "identification check advice"
).split()
"""What report.json takes from models.json."""


def numbers(
    filed: Cell, cell: Cell, identified: IdentifyResult, left: Mapping[str, Array], *, widths: bool
) -> Row:
    """Collect the numbers of report.json, without a verdict.

    Args:
        filed: The arm as its folder has it.
        cell: The same with the targets that were found.
        identified: Its fits.
        left: Residuals by model, `residuals_by_model`.
        widths: Whether intervals are wanted.

    Returns:
        The numbers.
    """
    fits, note, places = identified.fits, "", None
    if widths:
        try:
            places = workspace_half_widths(filed, identified)
        except (PoseError, NoEquilibrium) as err:
            note = str(err)
    return Row(
        {key: fits[key] for key in ("arm", "dataset", "runs", "poses", "recommended", "why")},
        models=[_model(own, identified, places) for own in fits.models],
        failed=[Row(vars(own), conservative=None, rank=None) for own in fits.failed],
        noise_p95_mm=MM * _noise_limit(identified.runs.every),
        residuals=_residuals(identified, left),
        seen=_seen(cell, identified),
        details=_details(cell, identified, left),
        laws=_laws(identified),
        map=places,
        no_map="intervals were not asked for" if not widths else note,
        doubts=[vars(doubt) for doubt in fits.doubts],
        unchecked=Row(vars(fits.unchecked)),
        notes=list(fits.notes),
        scale=fits.scale,
    )


def identifiability(cell: Cell, identified: IdentifyResult) -> Row:
    """Judge what the fitted runs do not show of the model to take, and what else to measure.

    Args:
        cell: The arm with the targets that were found.
        identified: Its fits.

    Returns:
        The expected error at random poses, the same after one more way to measure each, and the directions
        that the runs do not show.
    """
    data, regression = identified.runs.used, identified.taken.of_compliances
    own: Identifiability = of_regression(cell.vjm, regression, data, cad_prior(cell.arm), USUAL)
    return Row(
        structure=own.structure.name,
        equations=own.equations,
        expected_error_mm=finite(MM * own.error),
        expected_deflection_mm=finite(MM * own.deflection),
        lost_to_structure=len(own.lost_to_structure),
        lost_to_loads=len(own.lost_to_loads),
        lost_to_poses=own.lost_to_poses,
        prior_decides=int((own.share < DECIDED).sum()),
        help=[
            Row(place=p.place, measure=p.words, rank=p.rank, expected_error_mm=finite(MM * p.error))
            for p in own.proposals
        ],
        unseen=unseen_poses(own),
    )


def _details(cell: Cell, identified: IdentifyResult, left: Mapping[str, Array]) -> Row:
    """Collect what figures show of the models that are compared, beside a prior known to 30 %."""
    names = compared_models(identified.fits.models, identified.fits.recommended)
    compared = {name: identified.estimates[name] for name in names}
    prior = cad_prior(cell.arm)
    return fit_details(cell.vjm, identified.runs.every, compared, left, prior, USUAL.uncertainty)


def _laws(identified: IdentifyResult) -> list[Row]:
    """List what joints do beyond a linear spring, by the model to take; nothing of a linear one."""
    taken = next(own for own in identified.fits.models if own.name == identified.fits.recommended)
    return [
        Row(
            part=name,
            stiffer_percent=100 * own["stiffening"],
            backlash_urad=UM * own["backlash"],
            friction_urad=UM * own["friction"],
            strut_percent=100 * own[STRUT] if STRUT in own else None,
            **{kind: own.get(kind) for kind in joint_laws.added},
        )
        for name, own in taken.laws.items()
    ]


def held_out(
    identified: IdentifyResult, left: Mapping[str, Array], fewest: int
) -> tuple[Mapping[str, Array], str]:
    """Give the RMS error of every model in each run that was held out [mm].

    Where these runs are none or too few, the errors are those of cross-validation.

    Args:
        identified: The fits.
        left: Residuals by model, `residuals_by_model`.
        fewest: Least number of runs that a verdict takes.

    Returns:
        Errors by model, (n,) each, and what one of the n is.
    """
    data, check = identified.runs.every, identified.runs.check
    held = np.isin(data.pose, [] if check is None else check.pose) & data.seen.any(axis=1)
    if held.sum() < fewest and identified.held_out:
        return identified.held_out, "group of fitted runs held out in turn"
    count = np.maximum(data.seen[held].sum(axis=1), 1)
    rms = {name: MM * np.sqrt((own[held] ** 2).sum(axis=(1, 2)) / count) for name, own in left.items()}
    return rms, "run held out"


def _model(row: Row, identified: IdentifyResult, places: Row | None) -> Row:
    """Describe a model; its compliances are in models.json."""
    held = {other.name: other.f_m for other in identified.fits.held_out}
    return Row(
        {key: row[key] for key in OF_MODEL},
        rejected=len(row.rejected),
        aggregated=[name for name, compliance in row.joints.items() if compliance is None],
        f_m_held_out=held.get(row.name),
        intervals=Row({key: x for key, x in (row.intervals or {}).items() if key != "deflections"}),
        elsewhere=None if places is None else _there(row.name, places),
    )


def _there(name: str, places: Row) -> Row | None:
    """Tell how sure a model is over the workspace, and how far from the one to take; None if unknown."""
    if name not in places.errors.error_mm:
        return None
    mm, apart = places.errors.errors(name), places.apart_mm.get(name)
    return Row(
        half_width_mm=places.errors.typical_mm(name) if np.isfinite(mm).any() else None,
        unbounded=places.errors.unbounded(name),
        apart_mm=float(np.median(apart)) if apart else None,
    )


def residuals_by_model(cell: Cell, identified: IdentifyResult) -> dict[str, Array]:
    """Subtract models from readings, (runs, m, 3) [m] by model; 0 where a target was lost.

    Args:
        cell: The arm with its model and its truth.
        identified: The fits.

    Returns:
        Residuals by model, (runs, m, 3) [m].
    """
    data, names = identified.runs.every, list(identified.estimates)
    moved = all_deflections(cell.vjm, [identified.estimates[name] for name in names], data)
    left = data.deflection - data.as_read(moved)
    return dict(zip(names, np.where(data.seen[..., None], left, 0.0), strict=True))


def largest_vector(vectors: Array) -> Array:
    """Give the length of the longest vector of every run, (runs, m, 3) to (runs,)."""
    return np.asarray(np.linalg.norm(vectors, axis=2).max(axis=1))


def _residuals(identified: IdentifyResult, left: Mapping[str, Array]) -> list[Row]:
    """List per run the largest motion of a target, and the largest residual of each model."""
    data, check = identified.runs.every, identified.runs.check
    held = np.isin(data.pose, [] if check is None else check.pose)
    moved = MM * largest_vector(np.where(data.seen[..., None], data.deflection, 0.0))
    sizes = {name: (MM * largest_vector(own)).tolist() for name, own in left.items()}
    return [
        Row(
            run=int(data.run[k]),
            which_run=f"{data.run[k]}{' (held out)' if held[k] else ''}",
            pose=int(data.pose[k]),
            held_back=bool(held[k]),
            moved_mm=float(moved[k]),
            residual_mm={name: mm[k] for name, mm in sizes.items()},
            taken_mm=sizes[identified.fits.recommended][k],
        )
        for k in range(data.runs)
    ]


def _seen(cell: Cell, identified: IdentifyResult) -> Row:
    """Tell how much the runs say of each link and joint, beside a prior known to 30 %."""
    regression = identified.taken.of_compliances
    component, share = explained_variance(cell.vjm, regression, cad_prior(cell.arm), USUAL)
    own = {name: share[np.array(component) == name] for name in dict.fromkeys(component)}
    return Row(
        structure=regression.structure.name,
        unknowns=regression.structure.n,
        seen=regression.rank,
        prior_uncertainty_percent=100 * USUAL.uncertainty,
        blocks=[
            Row(
                part=name,
                parameters=len(shares),
                told_percent=100 * float(shares.mean()),
                decided_by_prior=int((shares < DECIDED).sum()),
            )
            for name, shares in own.items()
        ],
    )


def compared_models(models: Sequence[Row], taken: str) -> list[str]:
    """Name one's own, least squares, GCO without prior, joints alone, if fitted; last the model to take.

    Args:
        models: The models.
        taken: The recommended model.

    Returns:
        Names of the models.
    """
    others = [m for m in models if not m.prior and m.name != taken]
    links = [m for m in others if m.structure != JOINTS]
    kinds = ([m for m in links if m.constraint == kind] for kind in ("none", "psd"))
    joints = [m for m in others if m.structure == JOINTS]
    mine = [m.name for m in models if m.constraint == "own" and m.name != taken]
    return [*mine, *(rows[0].name for rows in (*kinds, joints) if rows), taken]


def workspace_half_widths(cell: Cell, identified: IdentifyResult) -> Row:
    """Predict the half widths of the tool's deflection over the workspace, under the largest fitted load.

    Args:
        cell: The arm with its model and its truth.
        identified: The fits.

    Returns:
        Half widths of the 95 % intervals by model.

    Raises:
        PoseError: When no poses can be drawn.
        NoEquilibrium: When the model to take has none.
    """
    data, taken = identified.runs.used, identified.fits.recommended
    k = int(np.linalg.norm(data.wrench[:, :3], axis=1).argmax())
    load = Load(data.wrench[k], data.point[k])
    q = clear_poses(cell, None, PLACES, trial_rng(0))
    moved, half, missing = {}, {}, []
    mine = {m.name for m in identified.fits.models if m.constraint == "own"} - {taken}
    for name in (name for name in compared_models(identified.fits.models, taken) if name not in mine):
        arm_model = cell.model(identified.estimates[name])
        try:
            there = predict(arm_model, q, [load], points=np.zeros((0, 3)))
        except NoEquilibrium:
            if name == taken:
                raise
            missing.append(name)
        else:
            moved[name], half[name] = there.deflection[:, 0], there.widest[:, 0]
    workspace_poses = places_at(cell.arm, q, tool_pose(cell.vjm, q)[0], np.linalg.norm(moved[taken], axis=1))
    # joints alone are not compared: what they leave out is in no half width
    shown = [name for name in half if name != JOINTS or name == taken]
    errors = error_places(
        workspace_poses, {name: bounded_mm(own) for name, own in half.items()}, shown, HALF_WIDTH
    )
    order = np.array(errors.run) - 1
    apart = {name: np.linalg.norm(own - moved[taken], axis=1) for name, own in moved.items() if name != taken}
    return Row(
        force_N=float(np.linalg.norm(load.wrench[:3])),
        moment_Nm=float(np.linalg.norm(load.wrench[3:])),
        places=len(q),
        errors=errors,
        apart_mm={name: kept_mm(own[order]) for name, own in apart.items()},
        missing=missing,
        **_certainty(MM * half[taken]),
    )


def _certainty(half: Array) -> Mapping[str, float | None]:
    """Summarise half widths (n,) [mm]: least, median, 95 %, and how many have no bound."""
    known = half[np.isfinite(half)]
    low, middle, most = np.quantile(known, (0, 0.5, 0.95)).tolist() if known.size else (None,) * 3
    return {"without_bound": len(half) - known.size, "least_mm": low, "median_mm": middle, "p95_mm": most}


def _noise_limit(data: Dataset) -> float:
    """Give the 95th percentile of the largest of m noisy deflections, of three normal components each [m]."""
    from scipy.special import gammaincinv  # here: importing it takes longer than most fits

    share = 0.95 ** (1 / len(data.markers))
    if data.lines.any():  # one component each, of a variance that contains the tilt
        variance = np.trace(data.covariance, axis1=2, axis2=3)[data.lines]
        return float(np.sqrt(2 * gammaincinv(1 / 2, share) * variance.mean()))
    squared = 2 * gammaincinv(3 / 2, share)  # quantile of chi squared
    return float(data.sigma * np.sqrt(2 * squared))
