"""Numbers of a calibration: how far readings are off, which errors were tried, what the arm is.

Numbers of a calibrated arm have their 95 % intervals, by name and in the units of people.

A joint and the turn of the link before it about its axis are one to the readings, for errors and for
compliances: the first is counted with the second, as in the paper's aggregation.
"""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np

from testbench.arm.folder import ArmJoint
from testbench.data.dataset import Series, mean_numbers_per_reading, select_rows
from testbench.errors import Array, Ids
from testbench.identify.absolute.align import Noise, align_all, residuals
from testbench.identify.absolute.choose import SelectionStep
from testbench.identify.absolute.evidence import DEFAULT_ERROR_SCALES, WIDE_PRIOR, ActiveUnknowns
from testbench.identify.absolute.evidence import MAX_PRIOR_DEVIATION_FACTOR as MOST_OF_USUAL
from testbench.identify.absolute.fit import Calibration, posterior_of_calibration
from testbench.identify.absolute.posterior import further_information
from testbench.identify.absolute.state import (
    ArmState,
    Unknowns,
    nominal_state,
    series_equilibrium,
    with_error_terms,
)
from testbench.identify.estimate import Estimate
from testbench.identify.posterior import Posterior
from testbench.identify.registration import READING_LOSS
from testbench.runs.rows import Row
from testbench.workflows.absolute import FREE_DEVIATION as LOOSE_FRAME
from testbench.workflows.absolute import (
    FURTHER,
    Calibrated,
    distance_statistics,
    hidden_geometry,
    unobservable,
)
from testbench.workflows.arm_models import loads_about_tool, origin_of, write_files
from testbench.workflows.rows import MM, UM, rounded

# --- Numbers of a calibrated arm with their 95 % intervals, by name and in the units of people --------------

AXES = ("shift x", "shift y", "shift z", "turn x", "turn y", "turn z")
Named = tuple[str, str, Array]
"""A number of an arm: name, unit in which it is shown, and what it is per unit of every unknown, (size,)."""


def geometry_errors(active: ActiveUnknowns) -> Iterator[Named]:
    """List the constants of the inner links' virtual joints, such as "link_2 turn y"."""
    every = np.eye(active.unknowns.size)[active.unknowns.columns("geometry")]
    for row, (link, axis) in zip(every, product(active.unknowns.vjm.arm.links[1:-1], AXES), strict=True):
        yield f"{link.name} {axis}", "mm" if axis in AXES[:3] else "mrad", row


def joint_compliances(active: ActiveUnknowns) -> Iterator[Named]:
    """List each joint's compliance with that of the link before it about, of a slide along, its axis."""
    unknowns, arm = active.unknowns, active.unknowns.vjm.arm
    a, b = unknowns.structure.rows, unknowns.structure.columns
    for k, joint in enumerate(arm.joints):
        v, row = np.zeros(arm.n_theta), np.zeros(unknowns.size)
        v[6 * k + (0 if joint.prismatic else 3) + np.arange(3)] = unknowns.vjm.joint_axes_in_beam_frame[k]
        row[unknowns.columns("elastic")] = v[a] * v[b] * np.where(a == b, 1, 2)  # v^T C_theta v, of the link
        row[unknowns.columns("elastic")] += (a == b) & (a == 6 * len(arm.links) + k)
        yield joint.name, "um/N" if joint.prismatic else "urad/(N m)", row


def interval_rows(calibration: Calibration, named: Iterable[Named]) -> list[Row]:
    """Compute numbers of a calibrated arm with the half width of their 95 % interval, each by itself.

    They count with the readings and the learnt priors: an error that readings cannot tell from another one,
    such as two shifts along one axis, has the interval of its prior. A value is 0 if it is rounding beside
    its interval.

    Args:
        calibration: The calibration.
        named: The numbers, linear in the unknowns.

    Returns:
        A row each: `name`, `value`, `half_95` and `unit`.
    """
    known, columns = posterior_of_calibration(calibration), calibration.active_unknowns.columns
    rows = []
    for name, unit, functional in named:
        scale = MM if unit.startswith("m") else UM
        value = scale * float(functional[columns] @ known.mean)
        [half] = (scale * known.half_widths(functional[None, columns])).tolist()
        rows.append(Row(name=name, value=value * (abs(value) > NOTHING * half), half_95=half, unit=unit))
    return rows


# --- Numbers of a calibration: how far readings are off, which errors were tried, what the arm is -----------

NEGATIVE = "No arm bends against its load: the model explains the sag by other errors. Do not use it."
#: Error of held-out readings over that of the arm as drawn from which poses are too few [1].
TOO_FEW_POSES_ERROR = 1.5
SOUND = 0.8  #: Share of the readings that are sound: more outliers are a misfit [1].
ABOVE, CONTRADICTED = 1.05, 2.0
"""Fitted error over that of the arm as drawn, and over that of held-out readings, from which a calibrated arm
is rejected: sound ones are below 1 of both [1]."""
PRESSED = 40.0, 0.05
"""Chi squared that negative compliances would take away from which they are wanted, and over all equations
[1]: sound readings reach 0.02."""
SIGNIFICANT = 3.0  #: Standard deviations above which the amplitude of an order is more than scatter.
NOTHING = 1e-6  #: Share of the half width of its interval below which a value is rounding [1].
MAX_OUTLIER_WEIGHT = 0.5  #: Robust weight below which a reading is listed as an outlier [1].
LISTED_OUTLIERS = 10  #: Outliers that are listed, the farthest.
MAX_RANGES, MIN_RANGES, POSES_PER_RANGE = 24, 4, 8
"""Ranges of a joint at most and at least, and the poses that each should have on average."""
CURVE = 361  #: Angles at which the error of a joint is drawn.
ORDERS = 4  #: Periodic errors that are spoken of: higher ones look like nothing else.
RemainingErrors = tuple[list[Array], list[Array]]
"""Reading minus arm as drawn, and minus calibrated arm: of every series (rows, m, 3) [m], base axes."""


def remaining_errors(calibrated: Calibrated) -> RemainingErrors:
    """Find what the arms as drawn and as calibrated leave of the readings; zero where a target was lost."""
    state, series = calibrated.calibration.state, calibrated.calibration.series
    drawn = align_all(nominal_state(state.vjm, state.body_masses, state.torque_scale), series)
    before, after = (
        [residuals(arm, one)[: len(one.markers)].transpose(2, 0, 1) for one in series]
        for arm in (drawn, state)
    )
    return before, after


def numbers(calibrated: Calibrated, left: RemainingErrors, more: tuple[float, float] | None = None) -> Row:
    """Collect all numbers of a calibration.

    Args:
        calibrated: The calibration.
        left: What both arms leave of the readings, by `remaining_errors`.
        more: Expected errors over the workspace now, and after further poses, by `gain_of_further_poses` [m].

    Returns:
        Numbers by their keys in report.json, lengths in mm.
    """
    calibration, series = calibrated.calibration, calibrated.calibration.series
    before, after = (
        [np.linalg.norm(x, axis=2)[one.is_measured] for one, x in zip(series, every, strict=True)]
        for every in left
    )
    vjm, estimate = calibration.state.vjm, calibration.estimate
    q = np.concatenate([np.repeat(one.q, one.is_measured.sum(axis=1), axis=0) for one in series])
    every = np.concatenate(before), np.concatenate(after)
    pulled, note = outliers(calibration, left[1])
    f = Row(
        arm=vjm.arm.name,
        series=[_errors_of_series(*parts) for parts in zip(series, before, after, strict=True)],
        total_before=distance_statistics(MM * every[0]),
        total_after=distance_statistics(MM * every[1]),
        steps=[
            _step(step, math.sqrt(mean_numbers_per_reading(series))) for step in calibration.selection.steps
        ],
        places=[row for k, joint in enumerate(vjm.arm.joints) for row in _ranges(joint, q[:, k], q, *every)],
        spectrum=list(_spectrum(calibration)),
        pattern=_pattern(calibration.active_unknowns.unknowns),
        geometry=(geometry := interval_rows(calibration, geometry_errors(calibration.active_unknowns))),
        far_geometry=_far_geometry(calibrated, geometry),
        compliances=_compliances(calibration),
        **_solved(calibration),
        noise=_noise(calibration.noise, series),
        mounting=calibrated.mounting,
        weight_alone=not any(one.wrench.any() or one.torque is not None for one in series),
        left_open=list(_left_open(calibration)),
        notes=[*calibrated.notes, *note],
        **pulled,
    )
    f |= _validated(f)
    f["models"] = [_model(estimate, f)]
    f["rejected"] = _rejected(f, *(_nearest(x) for x in every))
    f["pressed"] = calibration.constraint_chi2 > max(
        PRESSED[0], PRESSED[1] * sum(one.n_equations for one in series)
    )
    f["more"] = more and Row(poses=FURTHER, now_mm=MM * more[0], after_mm=MM * more[1])
    f["doubts"] = [f"{name}: {text}" for name, text in calibration_doubts(f)]
    return f


def _errors_of_series(series: Series, before: Array, after: Array) -> Row:
    """Errors of a series, of the nominal and of the calibrated arm, (readings,) each [m]."""
    errors = {"before": distance_statistics(MM * before), "after": distance_statistics(MM * after)}
    return Row(series=series.name, rows=series.n_rows, **errors)


def _noise(noise: Noise, series: Sequence[Series]) -> Row:
    return Row(
        sigma_um=float(UM * np.sqrt(np.mean([readings.sigma**2 for readings in series]))),
        open_position_um=UM * noise.position_model_error,
        open_rotation_urad=UM * noise.rotation_model_error,
        position_factor=float(noise.factor[0]),
    )


def reason_against_use(f: Row) -> str:
    """Say why a calibrated arm must not be used; empty where nothing speaks against it."""
    if f.rejected:
        return str(f.rejected)
    if f.pressed:
        return "its best compliances are negative"
    return "too few poses: the calibration does not improve held-out positions" if f.worse else ""


def calibration_doubts(f: Row) -> Iterator[tuple[str, str]]:
    """List what may be wrong with the calibrated arm, the gravest first: a name and a sentence each."""
    if f.mounting:
        yield "Mounting", f"{f.mounting}."
    if f.pressed:
        scale = "Does the arm hang?" if f.weight_alone else "Is the sign of a force wrong?"
        yield "The best compliances are negative", f"{scale} {NEGATIVE}"
    if f.worse:
        far = "none could be held out, so the error at other poses is unknown"
        if f.held_out_mm:
            arms = f"from the calibrated arm and {f.total_before.rms_mm:.3f} mm from the nominal arm"
            far = f"held-out ones are {f.held_out_mm[1]:.3f} mm RMS {arms}"
        yield "Too few poses", f"{far}. Do not use the model; measure more poses."
    if f.far_geometry:
        yield "Implausible geometry", f"{f.far_geometry}."
    if ranges := _unread_words(f):
        yield "Extrapolated at joint angles without a reading", f"{ranges}."
    if f.weight_alone and f.compliances:
        scale = "the compliances are proportional to the masses in rigid.xml"
        words = "Masses 10 % too small make compliances 10 % too large; predicted positions stay correct."
        yield "Own weight is the only load", f"{scale}. {words}"
    if f.program and not f.program.conservative:
        yield "Not conservative", "a block of the compliances has a negative eigenvalue."
    if f.program and f.program.status != "solved":
        yield "Compliances", f"{f.program.method}, {f.program.status}."


def range_words(row: Row) -> str:
    """Name a range of a joint."""
    return f"{row.joint} {row.low:.0f} to {row.high:.0f} {row.unit}"


def _unread_words(f: Row) -> str:
    """Name the ranges without a reading, joint by joint, neighbours as one; empty for none."""
    ranges: dict[tuple[str, str], list[tuple[float, float]]] = {}
    for row in f.places:
        if not row.n:
            own, low = ranges.setdefault((row.joint, row.unit), []), row.low
            if own and own[-1][1] == low:
                low = own.pop()[0]
            own.append((low, row.high))
    return "; ".join(
        f"{joint} {', '.join(f'{low:.0f} to {high:.0f}' for low, high in own)} {unit}"
        for (joint, unit), own in ranges.items()
    )


def _nearest(distances: Array) -> float:
    """Root mean square of the nearest `SOUND` of distances, (n,) [m], so that outliers do not count [mm]."""
    return float(MM * np.sqrt((np.sort(distances)[: max(1, int(SOUND * len(distances)))] ** 2).mean()))


def _rejected(f: Row, before: float, after: float) -> str:
    """Why a calibrated arm is none: what it was fitted to lies too far from it; empty where it does not.

    Args:
        f: Numbers of the report.
        before: RMS distance of the nearest readings from the arm as drawn [mm].
        after: From the calibrated arm [mm].
    """
    ours = (
        f"the nearest {100 * SOUND:.0f} % of the fitted readings lie {after:.3f} mm from the calibrated arm"
    )
    if after > ABOVE * before:
        return f"{ours}, but {before:.3f} mm from the nominal arm"
    if f.held_out_mm and after > CONTRADICTED * f.held_out_mm[1]:
        return f"{ours}, held-out ones only {f.held_out_mm[1]:.3f} mm: the readings contradict each other"
    return ""


def _solved(calibration: Calibration) -> Row:
    """Eigenvalues of every block of compliances, and how they were found."""
    estimate, elastic = calibration.estimate, calibration.active_unknowns.compliance_prior
    if estimate is None or elastic is None:
        return Row(blocks=[], program=None)
    blocks = [
        Row(name=name, smallest=float(own[0]), largest=float(own[-1]))
        for name, own in zip(elastic.block_names, estimate.eigenvalues, strict=True)
    ]
    program = Row(
        method=estimate.method,
        constrained=estimate.constraint == "psd",
        status=estimate.status,
        conservative=estimate.conservative,
    )
    return Row(blocks=blocks, program=program)


def _model(estimate: Estimate | None, f: Row) -> Row:
    """The calibrated arm as the model of a run that is compared with others."""
    return Row(
        name="calibrated",
        structure=estimate.structure.name if estimate else "rigid",
        constraint=estimate.constraint if estimate else "none",
        prior=True,
        conservative=estimate and estimate.conservative,
        identification=f.total_after,
        check=Row(rms_mm=f.held_out_mm[1]) if f.held_out_mm else None,
    )


def _step(step: SelectionStep, length: float) -> Row:
    """A kind of error beside those kept before it: RMS distances of readings that were held out.

    Blocks of joint space, and whole series realigned: the latter None of a single series, the former where
    poses are too few to hold any out.

    Args:
        step: The trial of the kind.
        length: RMS distance of a reading over its RMS along an axis [1].
    """
    every = (step.rms_before, step.rms_after, step.series_rms_before, step.series_rms_after)
    mm = [MM * length * x if math.isfinite(x) else None for x in every]  # root mean squares of an axis
    keys = ("before_mm", "after_mm", "series_before_mm", "series_after_mm")
    return Row(zip(keys, mm, strict=True), name=step.name, kept=step.kept)


def _validated(f: Row) -> Row:
    """RMS distance of held-out readings by geometry alone and by all that was kept, and whether it is bad.

    `worse`: the calibrated arm predicts readings worse than the arm as drawn, or nothing says.
    """
    kept = [row.after_mm for row in f.steps if row.kept]
    ends = (f.steps[0].before_mm, kept[-1] if kept else f.steps[0].before_mm) if f.steps else (None, None)
    if ends[0] is None or ends[1] is None:
        return Row(held_out_mm=None, worse=bool(f.steps) and f.steps[0].series_after_mm is None)
    return Row(held_out_mm=list(ends), worse=ends[1] > TOO_FEW_POSES_ERROR * f.total_before.rms_mm)


def _ranges(joint: ArmJoint, own: Array, q: Array, before: Array, after: Array) -> Iterator[Row]:
    """Ranges of a joint from limit to limit, or over a turn of a hinge that turns farther.

    Args:
        joint: Of the arm.
        own: Its angle at every position that was read, (n,) [rad, m].
        q: All angles there, (n, joints).
        before: Distance from the arm as drawn, (n,) [m].
        after: From the calibrated arm, (n,) [m].
    """
    low, high = joint.lower, joint.upper
    if not joint.prismatic and high - low > 2 * np.pi:
        own, (low, high) = (own + np.pi) % (2 * np.pi) - np.pi, (-np.pi, np.pi)
    count = max(MIN_RANGES, min(MAX_RANGES, len(np.unique(q, axis=0)) // POSES_PER_RANGE))
    edges = np.linspace(low, high, count + 1)
    at = np.clip(np.searchsorted(edges, own, "right") - 1, 0, count - 1)
    for k in range(count):
        here = at == k
        sizes = [float(MM * np.sqrt((x[here] ** 2).mean())) if here.any() else None for x in (before, after)]
        yield Row(
            joint=joint.name,
            low=float(joint.display_factor * edges[k]),
            high=float(joint.display_factor * edges[k + 1]),
            unit=joint.display_unit,
            n=int(here.sum()),
            before_mm=sizes[0],
            after_mm=sizes[1],
        )


def _spectrum(calibration: Calibration) -> Iterator[Row]:
    """Amplitudes of every order of a joint that is on; the standard deviation is that along the amplitude."""
    unknowns, active = calibration.active_unknowns.unknowns, calibration.active_unknowns
    orders = unknowns.error_terms.orders
    size = unknowns.error_terms.n_coefficients
    first = unknowns.first_columns["errors"]
    if not orders or not np.isin(first, active.columns):
        return
    known = posterior_of_calibration(calibration)
    for k, joint in enumerate(unknowns.vjm.arm.joints):
        if joint.prismatic:
            continue
        on = first + k * size + np.arange(2 * len(orders)).reshape(2, -1)  # sines, cosines
        columns = np.searchsorted(active.columns, on)
        pair = known.mean[columns].T
        amplitude = np.linalg.norm(pair, axis=1)
        along = np.where(amplitude[:, None] > 0, pair, 1.0)
        along /= np.linalg.norm(along, axis=1, keepdims=True)
        lines = known.covariance_root[:, columns]  # (c, 2, orders)
        deviation = np.linalg.norm(np.einsum("oa,cao->co", along, lines), axis=0)
        rows = [
            Row(order=order, amplitude_urad=a, deviation_urad=s)
            for order, a, s in zip(orders, (UM * amplitude).tolist(), (UM * deviation).tolist(), strict=True)
        ]
        yield Row(
            joint=joint.name,
            rms_urad=float(UM * np.sqrt((amplitude**2).sum() / 2)),
            largest=max(rows, key=lambda row: float(row.amplitude_urad)),
            significant=int((amplitude > SIGNIFICANT * deviation).sum()),
            curve=joint_curve(
                known, columns, orders, np.concatenate([series.q[:, k] for series in calibration.series])
            ),
            orders=rows,
        )


def joint_curve(known: Posterior, columns: Ids, orders: Sequence[int], q: Array) -> Row:
    """Compute the periodic error of a joint with its 95 % interval over the angles that were measured.

    Args:
        known: What the readings tell of the unknowns.
        columns: Places of the sines and cosines among them, (2, orders).
        orders: Their orders.
        q: Angles of the joint that were measured [rad].

    Returns:
        Angles, and the error with the ends of its interval.
    """
    angle = np.linspace(q.min(), q.max(), CURVE)
    turns = np.outer(angle, orders)
    functionals = np.zeros((CURVE, len(known.mean)))
    functionals[:, columns[0]], functionals[:, columns[1]] = np.sin(turns), np.cos(turns)
    return Row(
        angle_deg=rounded(np.degrees(angle)),
        error_urad=rounded(UM * functionals @ known.mean),
        half_urad=rounded(UM * known.half_widths(functionals)),
    )


def _pattern(unknowns: Unknowns) -> list[Row]:
    """Joints that share a periodic error, and how each has it, of one: f(q + turn), mirrored -f(turn - q)."""
    if (pattern := unknowns.shared_pattern) is None:
        return []
    joints = [unknowns.vjm.arm.joints[k].name for k in pattern.joints]
    every = zip(joints, np.degrees(pattern.shifts).tolist(), pattern.signs, strict=True)
    return [Row(joint=name, turn_deg=turn, mirrored=sense < 0) for name, turn, sense in every]


def _far_geometry(calibrated: Calibrated, geometry: Sequence[Row]) -> str:
    """The largest error of geometry where no arm has it, and what may hide in it; empty where it is usual."""
    most = MM * MOST_OF_USUAL * DEFAULT_ERROR_SCALES["geometry turn"]
    worst = max(geometry, key=lambda row: abs(row.value), default=None)
    if worst is None or abs(worst.value) <= most:
        return ""
    return (
        f"{worst.name} is {worst.value:.0f} {worst.unit}; sound arms stay below {most:.0f}. "
        f"{hidden_geometry(calibrated)}"
    )


def _compliances(calibration: Calibration) -> list[Row]:
    """Of every joint with that of the link before it, beside the same of the arm's folder."""
    if calibration.active_unknowns.compliance_prior is None:
        return []
    vjm = calibration.state.vjm
    rows = []
    known = interval_rows(calibration, joint_compliances(calibration.active_unknowns))
    every = zip(known, vjm.arm.joints, vjm.arm.links[:-1], vjm.joint_axes_in_beam_frame, strict=True)
    for row, joint, link, axis in every:
        part = slice(0, 3) if joint.prismatic else slice(3, 6)
        folder = joint.compliance + float(axis @ link.compliance[part, part] @ axis)
        rows.append(Row(row, folder=UM * folder))
    return rows


def outliers(calibration: Calibration, after: Sequence[Array]) -> tuple[Row, list[str]]:
    """Find positions that count less than sound ones, and list the farthest of those that hardly count.

    Args:
        calibration: The calibration.
        after: Reading minus calibrated arm, of every series (rows, m, 3) [m].

    Returns:
        `less_pull_percent`, the share of positions with less than full weight, and `outliers`, the farthest
        positions with a weight below MAX_OUTLIER_WEIGHT; and the note about these, if there are some.
    """
    series = calibration.series
    weights = [x[: len(one.markers)].T for x, one in zip(calibration.robust_weights, series, strict=True)]
    counted = np.concatenate([weight[one.is_measured] for weight, one in zip(weights, series, strict=True)])
    wild = [
        Row(
            series=one.name,
            row=int(one.row_id[row]),
            marker=one.markers[k],
            error_mm=float(MM * np.linalg.norm(left[row, k])),
            pull=float(weight[row, k]),
        )
        for one, weight, left in zip(series, weights, after, strict=True)
        for row, k in np.argwhere((weight < MAX_OUTLIER_WEIGHT) & one.is_measured)
    ]
    worst = sorted(wild, key=lambda row: -float(row.error_mm))[:LISTED_OUTLIERS]
    note = [
        f"{len(wild)} of {len(counted)} positions are off by more than "
        f"{READING_LOSS.threshold / MAX_OUTLIER_WEIGHT:g} standard deviations and have less than half of the "
        f"usual weight; the worst is row {row.row} of {row.series}, by {row.error_mm:.4g} mm"
        for row in worst[:1]
    ]
    return Row(less_pull_percent=float(100 * (counted < 1).mean()), outliers=worst), note


def _left_open(calibration: Calibration) -> tuple[str, ...]:
    """What readings leave open, and what hides behind what; periodic errors of high orders count as known."""
    active, unknowns = calibration.active_unknowns, calibration.active_unknowns.unknowns
    few, columns = _slow(active)
    deviation = np.zeros(unknowns.size)
    deviation[active.columns[: active.n_rigid]] = calibration.selection.error_scales.deviation[
        active.columns[: active.n_rigid]
    ]
    loose = np.where(np.isinf(deviation), LOOSE_FRAME, deviation)[columns]
    prior = np.diag(loose**2)
    if active.compliance_prior is not None:
        L = WIDE_PRIOR.relative * active.compliance_prior.L
        prior[-len(L) :, -len(L) :] = L @ L.T
    state = with_error_terms(calibration.state, few.error_terms)
    information = calibration.information[np.ix_(columns, columns)]
    return unobservable(few, information, prior, further_information(few, state, calibration.series))


def _slow(active: ActiveUnknowns) -> tuple[Unknowns, Ids]:
    """The unknowns without periodic errors of higher orders, and where they stand among all."""
    unknowns, errors = active.unknowns, active.unknowns.error_terms
    every, size = np.arange(unknowns.size), errors.n_coefficients
    kept = np.pad(np.tile(errors.orders, 2), (0, size - 2 * len(errors.orders))) <= ORDERS
    of_joints = every[unknowns.columns("errors")].reshape(unknowns.vjm.arm.n_joints, size)[:, kept]
    structure, elastic = unknowns.structure, every[unknowns.columns("elastic")]
    if active.compliance_prior is not None:
        structure, elastic = active.compliance_prior.structure, active.columns[active.n_rigid :]
    few = replace(unknowns, error_terms=replace(errors, orders=errors.orders[:ORDERS]), structure=structure)
    return few, np.concatenate([every[: unknowns.first_columns["errors"]], of_joints.ravel(), elastic])


def rows_of(calibrated: Calibrated, left: RemainingErrors, some: Ids) -> Row:
    """Collect some readings of all series with the calibrated arm at each.

    Args:
        calibrated: The calibration.
        left: What both arms leave of the readings, by `remaining_errors`.
        some: Numbers of the rows, from the first series to the last one, (rows,).

    Returns:
        Names of the series and numbers of the rows in their files, (rows,); joints `q`, (rows, n) [rad, m];
        tool position `tool`, (rows, 3) [m]; virtual joints `sag`, (rows, n_theta) [m, rad]; targets as read,
        and reading minus arm as drawn (`before`) and calibrated (`after`), (rows, targets, 3) [m]. NaN where
        a target was lost, or where another series has more targets.
    """
    state = calibrated.calibration.state
    first = 0
    parts = []
    targets = max(len(one.markers) for one in calibrated.calibration.series)
    for series, *both in zip(calibrated.calibration.series, *left, strict=True):
        at = some[(first <= some) & (some < first + series.n_rows)] - first
        parts.append(_rows_of_one(state, select_rows(series, at), [x[at] for x in both], targets))
        first += series.n_rows
    return Row({key: np.concatenate([part[key] for part in parts]) for key in parts[0]})


def _rows_of_one(state: ArmState, series: Series, left: Sequence[Array], targets: int) -> Row:
    equilibrium = series_equilibrium(state, series)
    read = equilibrium.chain.tool_points_in_world(state.mount(series).points) + left[1]
    before, after, at = (np.full((series.n_rows, targets, 3), np.nan) for _ in range(3))
    for values, own in ((before, left[0]), (after, left[1]), (at, read)):
        values[:, : len(series.markers)] = np.where(series.is_measured[..., None], own, np.nan)
    sag = (state.C_theta @ equilibrium.generalised_loads).T
    names = np.full(series.n_rows, series.name, dtype=object)
    return Row(
        **{
            "name": names,
            "row": series.row_id,
            "q": series.q,
            "tool": equilibrium.chain.tool_position,
            "sag": sag,
        },
        **{"read": at, "before": before, "after": after},
    )


def largest_remaining_error(calibrated: Calibrated, left: RemainingErrors) -> Array:
    """Find the largest error of the calibrated arm in every row, (rows,) [m]; -1 of unread rows.

    Args:
        calibrated: The calibration.
        left: Errors that remain.

    Returns:
        Error, (rows,) [m]; -1 of unread rows.
    """
    sizes = [
        np.where(series.is_measured, np.linalg.norm(x, axis=2), -1.0).max(axis=1)
        for series, x in zip(calibrated.calibration.series, left[1], strict=True)
    ]
    return np.concatenate(sizes)


def write_model(
    calibration: Calibration, data: Mapping[str, str], doubts: Sequence[str], folder: Path
) -> None:
    """Write a calibrated arm into a folder that exists.

    Args:
        calibration: The calibration.
        data: SHA-256 of every file of readings, by name.
        doubts: Warnings that go with the model.
        folder: The folder.
    """
    vjm = calibration.active_unknowns.unknowns.vjm
    kept = [step.name for step in calibration.selection.steps if step.kept]
    method = f"absolute calibration: {', '.join(['geometry', *kept])}"
    loads = np.concatenate([loads_about_tool(vjm, series) for series in calibration.series])
    model = replace(calibration.model(), origin=origin_of(method, data, doubts, loads))
    write_files(model, folder, name=method, fit={})
