"""Numbers of fits to a user's runs: residuals, half widths over the workspace, what the runs tell."""

from collections.abc import Mapping, Sequence
from statistics import NormalDist

import numpy as np

from testbench.arm.folder import Arm
from testbench.correct.predicted import predict
from testbench.data.dataset import Dataset, select_evenly
from testbench.errors import Array, NoEquilibrium, PoseError
from testbench.identify.conic import trace_units
from testbench.identify.estimate import MIN_RESIDUALS, Estimate, deflections_of_models, lilliefors_p_value
from testbench.identify.observability import (
    PRIOR_DECIDES_SHARE,
    Identifiability,
    describe_identifiability,
    explained_variance,
    scale_any_structure,
)
from testbench.identify.posterior import CONFIDENCE, posterior_of_estimate
from testbench.identify.prior import (
    Prior,
    PriorUncertainty,
    aggregate_left_out_joints,
    cad_prior,
    rows_in_prior_units,
)
from testbench.identify.regression import Regression
from testbench.model.laws import COMPENSATOR_KIND, joint_laws, set_load_history, vjm_for_structure
from testbench.model.load import Load
from testbench.model.structure import Structure
from testbench.model.vjm import Vjm, cross, evaluate_chain, generalised_load, tool_poses
from testbench.runs.rows import Row, finite, trial_rng
from testbench.workflows.cell import Cell, clear_poses
from testbench.workflows.error_places import PLACE_DIGITS, ErrorMeaning, error_places, places_at
from testbench.workflows.fits import IdentifyResult
from testbench.workflows.models import JOINTS_ONLY
from testbench.workflows.rows import MM, UM, rounded

# --- Details of fits that figures show ----------------------------------------------------------------------

BINS = 24  #: Bars of a histogram.
MAX_POINTS = 400  #: Predictions of a model that are kept.
COMPLIANCES = "reference", "estimate", "half"  #: Matrices of a link: see `link_compliances`.
ROUNDING = 1e-9  #: Share of the largest eigenvalue of a block below which one is zero.


def residual_histograms(residuals: Mapping[str, Array]) -> list[Row]:
    """Count the components of residuals, and test whether they are normal: Fig. 5 of the paper.

    Bars of a model reach up to its largest residual.

    Args:
        residuals: Readings minus predictions by model, each a number that was read, of any shape [m].

    Returns:
        A row for each model whose residuals are not all zero: `n`, `mean_um`, `deviation_um`, `lilliefors_p`
        (None of too few), edges of the bars `edges_um`, their `counts`, and its `name`.
    """
    rows = []
    for name, own in residuals.items():
        x = UM * np.ravel(own)
        if not x.any():
            continue
        reach = float(np.abs(x).max())
        counts, edges = np.histogram(x, BINS, (-reach, reach))
        enough = len(x) >= MIN_RESIDUALS and np.ptp(x) > 0
        rows.append(
            Row(
                n=len(x),
                mean_um=float(x.mean()),
                deviation_um=float(x.std(ddof=1)) if enough else None,
                lilliefors_p=lilliefors_p_value(x) if enough else None,
                edges_um=edges.tolist(),
                counts=counts.tolist(),
                name=name,
            )
        )
    return rows


def numbers_read(data: Dataset, residuals: Array) -> Array:
    """Take the numbers that were read: x, y and z of a position, one number of a reading along a line.

    Args:
        data: Says what was read.
        residuals: Readings minus predictions, (runs, m, 3) [m].

    Returns:
        The residuals of those numbers, (numbers,) [m].
    """
    if data.line_direction is None:
        return np.ravel(residuals[data.is_measured])
    placed, lines = data.is_measured & ~data.is_line_reading, data.is_measured & data.is_line_reading
    along = (data.line_direction * residuals).sum(axis=2)
    return np.concatenate([np.ravel(residuals[placed]), along[lines]])


def predictions(measured: Array, residuals: Mapping[str, Array]) -> Row:
    """Set lengths of predicted deflections beside those that were measured, of some targets evenly.

    Args:
        measured: Deflections, (points, 3) [m].
        residuals: Measured minus predicted by model, (points, 3) each [m].

    Returns:
        `measured_mm`, and by model `predicted_mm`.
    """
    some = select_evenly(np.arange(len(measured)), MAX_POINTS)
    return Row(
        measured_mm=_lengths(measured[some]),
        predicted_mm={name: _lengths((measured - x)[some]) for name, x in residuals.items()},
    )


def _lengths(vectors: Array) -> list[float]:
    return rounded(MM * np.linalg.norm(vectors, axis=-1))


def eigenvalues(arm: Arm, structure: Structure, C_theta: Array) -> list[Row]:
    """Compute the eigenvalues of every link's compliance, and the compliance of every joint.

    A translation counts as the rotation that causes it on an arm of `conic.LEVER_LENGTH`, so that all have
    one unit. That changes sizes; it changes no sign.

    Args:
        arm: The arm.
        structure: The unknowns.
        C_theta: Aggregated compliance, (n_theta, n_theta) [m/N, rad/(N m), rad/N].

    Returns:
        A row for each part: its name and `urad_per_Nm`, ascending; rounding is zero.
    """
    s = trace_units(structure)
    X = UM * C_theta / np.outer(s, s)
    links, first = len(arm.links), 6 * len(arm.links)
    blocks = [X[6 * k : 6 * k + 6, 6 * k : 6 * k + 6] for k in range(links)]
    values = [np.linalg.eigvalsh((block + block.T) / 2) for block in blocks]
    values += [X[k : k + 1, k] for k in range(first, arm.n_theta)]
    names = part_names(arm)
    return [
        Row(part=name, urad_per_Nm=rounded(np.where(np.abs(x) > ROUNDING * np.abs(x).max(), x, 0.0)))
        for name, x in zip(names, values, strict=True)
    ]


def part_names(arm: Arm) -> list[str]:
    """Name the links from the base on, then the joints."""
    return [*(link.name for link in arm.links), *(joint.name for joint in arm.joints)]


def sag_by_part(vjm: Vjm, estimate: Estimate, data: Dataset) -> list[Row]:
    """Split the deflection of the loaded point by the link or joint that causes it, Eq. (6).

    A part counts by what it moves the point along the whole deflection, so that the parts of a run sum to it.

    Args:
        vjm: The arm's virtual joint model.
        estimate: The identified compliances.
        data: Gives poses and loads.

    Returns:
        A row for each part, the largest first: `share_percent` of the deflection, the median of the runs,
        with its `least_percent` and `most_percent`.
    """
    vjm, arm = vjm_for_structure(vjm, estimate.structure), vjm.arm
    where = evaluate_chain(set_load_history(vjm, data.unloaded_after_load), data.q)
    theta = estimate.C_theta @ generalised_load(where, data.wrench, data.point)
    arm_of_load = np.einsum("rxy,ry->xr", where.tool_rotation, data.point)[:, None]
    moved = (where.J_theta[:3] + cross(where.J_theta[3:], arm_of_load)) * theta  # (3, n_theta, runs)
    links, joints = len(arm.links), arm.n_joints
    owner = np.r_[np.repeat(np.arange(links), 6), links + np.arange(joints)]
    if vjm.joint_laws is not None:
        owner = np.r_[owner, links + vjm.joint_laws.joint_indices]
    whole = moved.sum(axis=1)
    size = np.linalg.norm(whole, axis=0)
    bent = size > 0
    along = 100 * np.einsum("xkr,xr->kr", moved[:, :, bent], whole[:, bent]) / size[bent] ** 2
    shares = [along[owner == k].sum(axis=0) for k in range(links + joints)]
    rows = [
        Row(
            part=name,
            share_percent=float(np.median(own)),
            least_percent=float(own.min()),
            most_percent=float(own.max()),
        )
        for name, own in zip(part_names(arm), shares, strict=True)
        if own.size
    ]
    return sorted(rows, key=lambda row: -float(row.share_percent))


def singular_values(vjm: Vjm, regression: Regression, prior: Prior, uncertainty: float) -> list[float]:
    """Compute what the readings tell of each direction over what the prior tells, the largest first [1].

    They are singular values of the readings' rows in standard deviations, in the metric of the prior times
    its uncertainty: above one the readings decide a direction, below it the prior does.

    Args:
        vjm: The arm's virtual joint model.
        regression: The reduced readings.
        prior: In whose metric directions have one unit.
        uncertainty: Its relative standard deviation [1].

    Returns:
        The singular values [1].
    """
    rows = rows_in_prior_units(regression, scale_any_structure(prior, vjm, regression.structure))[0]
    return rounded(np.asarray(uncertainty * np.linalg.svd(rows, compute_uv=False), dtype=np.float64))


def joint_stiffness(vjm: Vjm, estimate: Estimate, prior: Prior, uncertainty: float) -> list[Row]:
    """Compare the stiffness of every joint with what was assumed of it, both with 95 % intervals.

    A joint counts with the turn of the link before it about its axis: to readings both are one.

    Args:
        vjm: The arm's virtual joint model.
        estimate: With a prior or without.
        prior: Compliances that were assumed.
        uncertainty: Their relative standard deviation [1].

    Returns:
        A row for each joint whose compliance is positive: its `unit`, and of `prior` and `posterior` the
        ends `low`, `high` and the `middle`; an end that has no bound is None.
    """
    plain, spread = (
        estimate.compliance_regression.structure,
        NormalDist().inv_cdf((1 + CONFIDENCE) / 2) * uncertainty,
    )
    assumed = plain.parameters_of(aggregate_left_out_joints(prior.C_theta, vjm, plain))
    L = scale_any_structure(prior, vjm, plain).L
    known = posterior_of_estimate(estimate)
    rows = []
    for k, joint in enumerate(vjm.arm.joints):
        before, after = (joint_functional(vjm, structure, k) for structure in (plain, estimate.structure))
        compliances = float(before @ assumed), float(after @ estimate.pi)
        if min(compliances) <= 0:
            continue
        half = (
            spread * float(np.linalg.norm(before @ L)),
            float(known.half_widths(after[None], CONFIDENCE)[0]),
        )
        prior_ends, posterior_ends = map(_stiffness, compliances, half)
        unit = "N/um" if joint.prismatic else "MN m/rad"
        rows.append(Row(joint=joint.name, unit=unit, prior=prior_ends, posterior=posterior_ends))
    return rows


def link_compliances(vjm: Vjm, estimate: Estimate, reference: Array, sag: Sequence[Row]) -> list[Row]:
    """Set the compliance of every link, its joint included, beside a reference, with 95 % half widths.

    The joint at the end of a link counts to the link, C + c a a^T: to readings both are one.

    Args:
        vjm: The arm's virtual joint model.
        estimate: With a prior or without.
        reference: Aggregated compliance of the true arm or of the arm's folder, (n_theta, n_theta).
        sag: Shares of the parts in the deflection, see `sag_by_part`.

    Returns:
        A row for each link from the base on: `part`, its `joint` (None of the last link), their
        `share_percent` of the deflection, and 6x6 in the link's frame `reference`, `estimate` and `half`,
        each [m/N, rad/N, rad/(N m)]. Of an entry that the model keeps zero or that has no bound the half
        width is None.
    """
    links = vjm.arm.links
    joints = vjm.arm.joints
    structure = estimate.structure
    share = {row.part: float(row.share_percent) for row in sag}
    first, upper = 6 * len(links), structure.fills_two_entries
    functionals = np.zeros((len(links), 6, 6, structure.n_parameters))
    rows = []
    for k, link in enumerate(links):
        own = (structure.rows // 6 == k) & (structure.rows < first)
        a = structure.rows[own] % 6
        b = structure.columns[own] % 6
        p = np.flatnonzero(own)
        functionals[k, a, b, p] = 1.0
        functionals[k, b[upper[own]], a[upper[own]], p[upper[own]]] = 1.0
        block = reference[6 * k : 6 * k + 6, 6 * k : 6 * k + 6].copy()
        if k < len(joints):
            v = _axis_in_link(vjm, k)
            springs = (structure.rows == structure.columns) & (structure.rows == first + k)
            functionals[k][:, :, springs] += np.outer(v, v)[:, :, None]
            block += reference[first + k, first + k] * np.outer(v, v)
        rows.append(
            Row(
                part=link.name,
                joint=joints[k].name if k < len(joints) else None,
                share_percent=sum(
                    share.get(name, 0.0) for name in (link.name, *(joint.name for joint in joints[k : k + 1]))
                ),
                reference=_square(block),
            )
        )
    half = posterior_of_estimate(estimate).half_widths(
        functionals.reshape(-1, structure.n_parameters), CONFIDENCE
    )
    half = np.where(functionals.any(axis=-1), half.reshape(-1, 6, 6), np.nan)
    return [
        Row(row, estimate=_square(own @ estimate.pi), half=_square(width))
        for row, own, width in zip(rows, functionals, half, strict=True)
    ]


def _square(block: Array) -> list[list[float | None]]:
    """Round a matrix to the digits that are kept, row by row; None where there is no number."""
    return [[finite(x) for x in rounded(row)] for row in block]


def _axis_in_link(vjm: Vjm, k: int) -> Array:
    """Return what joint k moves of the virtual joint of the link before it, a unit vector, (6,)."""
    v = np.zeros(6)
    v[(0 if vjm.arm.joints[k].prismatic else 3) + np.arange(3)] = vjm.joint_axes_in_beam_frame[k]
    return v


def joint_functional(vjm: Vjm, structure: Structure, k: int) -> Array:
    """Return what a joint and the link before it yield about the joint's axis, per unit of pi.

    Args:
        vjm: The arm's virtual joint model.
        structure: The unknowns.
        k: Place of the joint, from 0.

    Returns:
        The linear functional v^T C v + c, with v the axis in the link's frame, (n,).
    """
    links, v = 6 * len(vjm.arm.links), np.zeros(structure.n_theta)
    v[6 * k : 6 * k + 6] = _axis_in_link(vjm, k)
    a, b = structure.rows, structure.columns
    return np.asarray(v[a] * v[b] * np.where(a == b, 1.0, 2.0) + ((a == b) & (a == links + k)))


def _stiffness(compliance: float, half: float) -> Row:
    """Turn a compliance [rad/(N m), m/N] and its half width into a stiffness with ends [MN m/rad, N/um]."""
    low = compliance + half
    middle = compliance
    high = compliance - half
    return Row(
        low=1 / (UM * low) if np.isfinite(low) else None,
        middle=1 / (UM * middle),
        high=1 / (UM * high) if np.isfinite(high) and high > 0 else None,
    )


def fit_details(
    vjm: Vjm,
    runs: Dataset,
    estimates: Mapping[str, Estimate],
    residuals: Mapping[str, Array],
    prior: Prior,
    uncertainty: float,
) -> Row:
    """Collect what the figures of `identify` show beside its tables.

    Args:
        vjm: The arm's virtual joint model.
        runs: All runs of the user.
        estimates: By the name of the model, those that are compared; the model to take is the last one.
        residuals: Readings minus predictions by model, (runs, m, 3) [m].
        prior: That of the arm's folder.
        uncertainty: How well it is taken to be known [1].

    Returns:
        `residuals`, `predictions`, `eigenvalues`, `sag`, `compliances`, `singular_values` and `joints`, as
        the functions of this module have them.
    """
    seen, taken = runs.is_measured, [*estimates.values()][-1]
    sag = sag_by_part(vjm, taken, runs)
    left = {name: residuals[name][seen] for name in estimates}
    return Row(
        residuals=residual_histograms({name: numbers_read(runs, residuals[name]) for name in estimates}),
        predictions=predictions(runs.deflection[seen], left),
        eigenvalues={
            name: eigenvalues(vjm.arm, estimate.structure, estimate.C_theta)
            for name, estimate in estimates.items()
        },
        sag=sag,
        compliances=link_compliances(vjm, taken, prior.C_theta, sag),
        singular_values=singular_values(vjm, taken.compliance_regression, prior, uncertainty),
        joints=joint_stiffness(vjm, taken, prior, uncertainty),
    )


# --- Numbers of fits to a user's runs: residuals, half widths over the workspace, what the runs tell --------

NAMED = 3  #: Links and joints that are named of those that too few poses leave open.
AXES = ("stretch", "deflection y", "deflection z", "torsion", "rotation y", "rotation z")
"""Names of the diagonal entries of a link's compliance, in its beam frame: c11 to c66."""
PLACES = 200  #: Poses over the workspace.
USUAL = PriorUncertainty(0.3)  #: Of the prior that readings are compared with.
COUNTS = "it contains noise and prior, but no model error; the interval of Joints-only is too narrow"
"""What every interval of a model is told with."""
HALF_WIDTH = ErrorMeaning(
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
    fits = identified.fits
    names = compared_models(fits.models, fits.recommended)
    compared = {name: identified.estimates[name] for name in names}
    note, prior = "", cad_prior(cell.arm)
    places = None
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
        details=fit_details(cell.vjm, identified.runs.every, compared, left, prior, USUAL.relative),
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
    data, regression = identified.runs.used, identified.taken.compliance_regression
    own: Identifiability = describe_identifiability(cell.vjm, regression, data, cad_prior(cell.arm), USUAL)
    return Row(
        structure=own.structure.name,
        equations=own.max_independent_equations,
        expected_error_mm=finite(MM * own.expected_error),
        expected_deflection_mm=finite(MM * own.expected_deflection),
        lost_to_structure=len(own.lost_to_structure),
        lost_to_loads=len(own.lost_to_loads),
        lost_to_poses=own.n_lost_to_poses,
        prior_decides=int((own.explained_share < PRIOR_DECIDES_SHARE).sum()),
        help=[
            Row(
                place=p.ranking,
                measure=p.description,
                rank=p.rank,
                expected_error_mm=finite(MM * p.expected_error),
            )
            for p in own.proposals
        ],
        unseen=unseen_poses(own),
    )


def _laws(identified: IdentifyResult) -> list[Row]:
    """List what joints do beyond a linear spring, by the model to take; nothing of a linear one."""
    taken = next(own for own in identified.fits.models if own.name == identified.fits.recommended)
    return [
        Row(
            part=name,
            stiffer_percent=100 * own["stiffening"],
            backlash_urad=UM * own["backlash"],
            friction_urad=UM * own["friction"],
            strut_percent=100 * own[COMPENSATOR_KIND] if COMPENSATOR_KIND in own else None,
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
    held = np.isin(data.pose_id, [] if check is None else check.pose_id) & data.is_measured.any(axis=1)
    if held.sum() < fewest and identified.held_out:
        return identified.held_out, "group of fitted runs held out in turn"
    count = np.maximum(data.is_measured[held].sum(axis=1), 1)
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
    apart = places.apart_mm.get(name)
    return Row(
        half_width_mm=finite(places.errors.typical_mm(name)),
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
    moved = deflections_of_models(cell.vjm, [identified.estimates[name] for name in names], data)
    left = data.deflection - data.measured_components(moved)
    return dict(zip(names, np.where(data.is_measured[..., None], left, 0.0), strict=True))


def largest_vector(vectors: Array) -> Array:
    """Give the length of the longest vector of every run, (runs, m, 3) to (runs,)."""
    return np.asarray(np.linalg.norm(vectors, axis=2).max(axis=1))


def _residuals(identified: IdentifyResult, left: Mapping[str, Array]) -> list[Row]:
    """List per run the largest motion of a target, and the largest residual of each model."""
    data, check = identified.runs.every, identified.runs.check
    held = np.isin(data.pose_id, [] if check is None else check.pose_id)
    moved = MM * largest_vector(np.where(data.is_measured[..., None], data.deflection, 0.0))
    sizes = {name: (MM * largest_vector(own)).tolist() for name, own in left.items()}
    return [
        Row(
            run=int(data.run_id[k]),
            which_run=f"{data.run_id[k]}{' (held out)' if held[k] else ''}",
            pose=int(data.pose_id[k]),
            held_back=bool(held[k]),
            moved_mm=float(moved[k]),
            residual_mm={name: mm[k] for name, mm in sizes.items()},
            taken_mm=sizes[identified.fits.recommended][k],
        )
        for k in range(data.n_runs)
    ]


def _seen(cell: Cell, identified: IdentifyResult) -> Row:
    """Tell how much the runs say of each link and joint, beside a prior known to 30 %."""
    regression = identified.taken.compliance_regression
    component, share = explained_variance(cell.vjm, regression, cad_prior(cell.arm), USUAL)
    own = {name: share[np.array(component) == name] for name in dict.fromkeys(component)}
    return Row(
        structure=regression.structure.name,
        unknowns=regression.structure.n_parameters,
        seen=regression.rank,
        prior_uncertainty_percent=100 * USUAL.relative,
        blocks=[
            Row(
                part=name,
                parameters=len(shares),
                told_percent=100 * float(shares.mean()),
                decided_by_prior=int((shares < PRIOR_DECIDES_SHARE).sum()),
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
    links = [m for m in others if m.structure != JOINTS_ONLY]
    kinds = ([m for m in links if m.constraint == kind] for kind in ("none", "psd"))
    joints = [m for m in others if m.structure == JOINTS_ONLY]
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
    moved = {}
    half = {}
    missing = []
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
            moved[name], half[name] = there.deflection[:, 0], there.largest_half_width[:, 0]
    workspace_poses = places_at(cell.arm, q, tool_poses(cell.vjm, q)[0], np.linalg.norm(moved[taken], axis=1))
    # joints alone are not compared: what they leave out is in no half width
    shown = [name for name in half if name != JOINTS_ONLY or name == taken]
    errors = error_places(workspace_poses, {name: MM * own for name, own in half.items()}, shown, HALF_WIDTH)
    order = np.array(errors.run) - 1
    apart = {name: np.linalg.norm(own - moved[taken], axis=1) for name, own in moved.items() if name != taken}
    known = MM * half[taken][np.isfinite(half[taken])]
    low, middle, most = np.quantile(known, (0, 0.5, 0.95)).tolist() if known.size else (None,) * 3
    return Row(
        force_N=float(np.linalg.norm(load.wrench[:3])),
        moment_Nm=float(np.linalg.norm(load.wrench[3:])),
        places=len(q),
        errors=errors,
        apart_mm={name: rounded(MM * own[order], PLACE_DIGITS) for name, own in apart.items()},
        missing=missing,
        without_bound=len(q) - known.size,
        least_mm=low,
        median_mm=middle,
        p95_mm=most,
    )


def _noise_limit(data: Dataset) -> float:
    """Give the 95th percentile of the largest of m noisy deflections, of three normal components each [m]."""
    from scipy.special import gammaincinv  # here: importing it takes longer than most fits

    share = 0.95 ** (1 / len(data.markers))
    if data.is_line_reading.any():  # one component each, of a variance that contains the tilt
        variance = np.trace(data.covariance, axis1=2, axis2=3)[data.is_line_reading]
        return float(np.sqrt(2 * gammaincinv(1 / 2, share) * variance.mean()))
    squared = 2 * gammaincinv(3 / 2, share)  # quantile of chi squared
    return float(data.sigma * np.sqrt(2 * squared))


def unseen_poses(identifiability: Identifiability) -> list[Row]:
    """List the directions that the data do not show, a row for each set of links and joints that trade.

    Returns:
        Rows with `why` (structure: no experiment shows them; loads: no pose does under these loads; poses:
        these are too few), `parts`, the number of `directions`, and `parameters` that change in the first.
    """
    rows: dict[tuple[str, tuple[str, ...]], Row] = {}
    for why, lost in (
        ("structure", identifiability.lost_to_structure),
        ("loads", identifiability.lost_to_loads),
    ):
        for direction in lost:
            every = [*direction.parameters, *direction.minor_parameters]
            parts = tuple(dict.fromkeys(identifiability.parameter_components[k] for k in sorted(every)))
            names = ", ".join(_name(identifiability, k) for k in every)
            start = Row(why=why, parts=", ".join(parts), directions=0, parameters=names)
            rows.setdefault((why, parts), start)["directions"] += 1
    if identifiability.n_lost_to_poses:
        part, share = identifiability.parameter_components, identifiability.participation_lost_to_poses
        held = {name: share[np.array(part) == name].sum() for name in part}
        most = sorted(held, key=lambda name: -held[name])[:NAMED]
        rows["poses", ()] = Row(
            why="poses", parts=", ".join(most), directions=identifiability.n_lost_to_poses, parameters=""
        )
    return list(rows.values())


def _name(identifiability: Identifiability, parameter: int) -> str:
    """Name a parameter: its joint, or its link and axes."""
    part, (a, b) = (
        identifiability.parameter_components[parameter],
        identifiability.parameter_entries[parameter].tolist(),
    )
    if a < 0:
        return part
    return f"{part} {AXES[a]}" if a == b else f"{part} {AXES[min(a, b)]} with {AXES[max(a, b)]}"
