"""Numbers of a plan: its promise, its certificate, plans beside it, ranges that it reads first; plan.csv."""

import csv
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from testbench.arm.folder import Arm, ArmJoint
from testbench.data.dataset import Series
from testbench.design import absolute
from testbench.design.criteria import LinearCriterion, mean_square_weight
from testbench.design.exchange import greedy_plan
from testbench.design.forecast import Forecast, fit_error, forecast_fit, inflate_intervals
from testbench.design.planning import (
    N_RANDOM_PLANS,
    Plan,
    PriorInfluence,
    baselines,
    forecast_errors,
    observability,
    prediction_error_function,
    prior_influence,
)
from testbench.design.rows import PlanSpecification, deflection_rows, select_loads, task_rows
from testbench.errors import Array, Ids
from testbench.identify.prior import Prior, cad_prior
from testbench.model.structure import all153, joints_only
from testbench.model.vjm import evaluate_chain, tool_poses
from testbench.plant.rigid_cell import has_surroundings
from testbench.runs.rows import Row, finite, trial_rng
from testbench.workflows.error_places import ErrorMeaning, error_places, places_at, rms
from testbench.workflows.plan import AbsolutePlanned, Planned, scale_forecast, undetermined_by
from testbench.workflows.plan_settings import pull_words
from testbench.workflows.predicted_error import (
    error_map,
    forecast_summary,
    half_widths,
    least_squares,
    linear_fit_after,
    open_laws,
    prior_uncertainty,
    unloaded_joints,
    unobservable_joints,
)
from testbench.workflows.rows import MM

HIDDEN_SCALE = 0.5  #: Share of the deviation of an arm's scale that a plan leaves, above which it says so.
TARGET = 0.1  #: Error for which the fewest poses are told [mm].
MORE, LITTLE = 4, 0.10  #: So many more poses that bring less than this share are not worth their time.
CHANCE = 100  #: Random plans of absolute readings that a plan is compared with.
COUNTS = (10, 20, 30, 50, 75, 100, 150, 200)  #: Numbers of poses for which their errors are told.
CURVE = "poses greedy_mm random_median_mm random_p10_mm random_p90_mm"
CALIBRATED = "calibrated"  #: Name of the arm after a calibration.
POSITION = ErrorMeaning("expected error", "of the targets' positions after calibration", "RMS")


def numbers(made: Planned) -> Row:
    """Collect all numbers of plan.json."""
    cell = made.cell
    plan = made.plan
    arm = made.cell.arm
    margins = arm.distance_to_limits(plan.q).min(axis=0)
    efficiency = min(plan.efficiency, 1.0)
    own = Row(
        vars(made.settings),
        arm=arm.name,
        base_m=cell.vjm.base_pose[:3, 3].tolist(),
        joints=[joint.name for joint in arm.file_joints],
        units=[joint.display_unit for joint in arm.file_joints],
        margins=margins.tolist(),
        surrounded=has_surroundings(cell.room),
        error_mm=forecast_summary(made.forecast),
        certificate=Row(
            efficiency=efficiency,
            phi=plan.criterion_value,
            phi_bound=plan.relaxed_design.bound,
            examined=len(plan.candidates.q),
        ),
        candidates=Row(found=len(made.found.q), drawn=made.found.drawn, rejected=made.found.rejected),
    )
    own.update(_absolute(made) if isinstance(made, AbsolutePlanned) else _pairs(made))
    own["blocked"] = [row.run for row in own.plan if row.way == "via"]
    return Row(own, **_listed(own))


def _listed(f: Row) -> Row:
    """List numbers of a plan as rows of tables: plans beside it, the workspace, limits, candidates."""
    tried = {"feasible": f.candidates.found, "drawn": f.candidates.drawn}
    return Row(
        beside=_beside(f),
        rests=_rests(f),
        around=[row for row in f.map.rows() if row.worst_mm is not None],
        limits=[
            Row(joint=name, margin=x, unit=unit)
            for name, x, unit in zip(f.joints, f.margins, f.units, strict=True)
        ],
        refused=[Row(quantity=key, value=n) for key, n in {**tried, **f.candidates.rejected}.items() if n],
    )


def _beside(f: Row) -> list[Row]:
    """List the expected errors of this plan and of others [mm]."""
    chance, doubted = f.random_plans, f.get("error_if_prior_twice_as_uncertain_mm")
    beyond = f.get("beyond_mm")
    pairs = {
        "this plan": f.error_mm.expected,
        "this plan, without averaging of models": chance.get("planned_mm"),
        "this plan, read by a tracker instead of gauges": f.get("tracker_mm"),
        "this plan, with Joints-only": f.get("joints_alone_mm"),
        "this plan, with a prior twice as uncertain": doubted and doubted.expected,
        "this plan, with joint errors of all orders": beyond and math.hypot(f.error_mm.expected, beyond),
        "earlier readings alone": f.get("before_mm"),
    }
    known = [Row(what=name, mm=mm) for name, mm in pairs.items() if mm is not None]
    named = {
        f"random poses, median of {chance.plans} plans": chance.median_mm,
        "random poses, best tenth of the plans": chance.best_tenth_mm,
    }
    return [*known, *(Row(what=name, mm=mm) for name, mm in named.items())]


def _rests(f: Row) -> list[Row]:
    """List what a plan rests on: noise, prior, directions, certificate, advice."""
    seen = f.get("directions") or Row()
    told = f.get("advice") or Row()
    scale = f.get("scale") or Row()
    noise = f.gauge_um if f.get("gauges") else f.sigma_um
    pairs = {
        "noise of a reading, um": None if f.get("instruments") else noise,
        "uncertainty of the prior, %": f.uncertainty_percent,
        f"lower bound of the plan's efficiency (criterion {f.criterion}), %": 100 * f.certificate.efficiency,
        "candidate poses examined": f.certificate.examined,
        "unknowns": seen.get("unknowns"),
        "directions of the unknowns that these loads can determine": seen.get("shown"),
        "directions that the plan determines": seen.get("seen"),
        "directions in which readings outweigh the prior": seen.get("outweighed"),
        "share of the mean square error that the prior causes, %": seen.get("prior_share_percent"),
        "95 % half width of a deflection at the tasks, mm": f.get("half_width_95_mm"),
        f"fewest poses for an expected error of {TARGET:g} mm at the tasks": told.get("fewest"),
        f"number of poses after which {MORE} more lower the error by less than {100 * LITTLE:g} %": told.get(
            "enough"
        ),
        "error from periodic joint errors of higher orders, mm": f.get("beyond_mm"),
        "standard deviation of the arm's scale by the prior of its geometry, mm per m": scale.get(
            "before_mm_per_m"
        ),
        "standard deviation of the arm's scale after the plan, mm per m": scale.get("after_mm_per_m"),
        "error over the workspace that the arm's scale alone causes, mm": scale.get("error_mm"),
    }
    return [Row(quantity=name, value=value) for name, value in pairs.items() if value is not None]


def _pairs(made: Planned) -> Row:
    """What only a plan for tasks has."""
    cell = made.cell
    plan = made.plan
    prior = cad_prior(made.cell.arm)
    assert isinstance(plan, Plan)
    spec, rows = plan.specification, task_rows(plan.specification)
    scaling, influence = spec.setup.scaling, prior_influence(plan, rows)
    alone = linear_fit_after(least_squares(spec, prior, joints_only(cell.arm)), prior, plan.whitened_rows)
    drawn, rng = len(made.found.q) * len(spec.loads), trial_rng(made.settings.seed, 3)
    others = baselines(plan, rows, n_random_candidates=drawn, rng=rng)
    around, chance = made.workspace, others.random_errors[made.settings.poses]
    hidden = MM * math.sqrt(influence.unobservable_mean_square)
    return Row(
        model=scaling.structure.name,
        whole_arm=scaling.structure.n_parameters == all153(cell.arm).n_parameters,
        prior=None if spec.prior_uncertainty is None else scaling.prior_name,
        within_percent=100 * prior_uncertainty(spec),
        half_width_95_mm=MM * float(np.median(half_widths(made.forecast))),
        joints_alone_mm=MM
        * float(np.sqrt(np.square(fit_error(alone, spec.tasks.q, spec.tasks.load)).mean())),
        workspace_error_mm=forecast_summary(around) if math.isfinite(around.overall_rms_error) else None,
        error_if_prior_twice_as_uncertain_mm=None
        if spec.prior_uncertainty is None
        else forecast_summary(
            _at_tasks(replace(spec, prior_uncertainty=2 * spec.prior_uncertainty), plan, prior)
        ),
        random_plans=Row(
            plans=N_RANDOM_PLANS,
            planned_mm=MM * forecast_errors(plan, rows).overall_rms_error,
            median_mm=finite(MM * float(np.median(chance))),
            best_tenth_mm=_percentile(chance, 10),
        ),
        plan=_runs(made, plan),
        tracker_mm=None
        if plan.gauges is None
        else finite(MM * _at_tasks(spec, replace(plan, gauges=None), prior).overall_rms_error),
        tasks=_tasks(made, plan, rms(rows @ scaling.expected_x)),
        observability=observability(plan.candidates.problem, plan.chosen_indices),
        directions=_directions(plan, influence),
        curve=[
            _count(
                poses,
                finite(MM * others.greedy_errors[poses - 1]),
                [_percentile(own, p) for p in (50, 10, 90)],
            )
            for poses, own in others.random_errors.items()
        ],
        greedy_mm=[finite(MM * error) for error in others.greedy_errors],
        advice=_advice(MM * others.greedy_errors),
        map=error_map(cell, plan, around),
        open_laws=open_laws(plan, prior),
        unshown=unobservable_joints(plan, hidden / (MM * made.forecast.overall_rms_error)),
        unloaded=unloaded_joints(plan, prior),
    )


def _at_tasks(spec: PlanSpecification, plan: Plan, prior: Prior) -> Forecast:
    """Forecast errors at the tasks where the plan's poses are read or fitted in another way."""
    fit = linear_fit_after(spec, prior, plan.whitened_rows)
    return inflate_intervals(forecast_fit(fit, spec.tasks.q, spec.tasks.load))


def _poses(arm: Arm, made: tuple[Array, Array], forecast: Forecast, moved: tuple[str, Array]) -> list[Row]:
    """A row a pose: joints in their units, what moves the tool there, the error to expect.

    Args:
        arm: Whose poses they are.
        made: Joints of the chain, (poses, n) [rad, m], and where the tool is, (poses, 3) [m].
        forecast: Errors there.
        moved: What moves it, and by how much, (poses,) [m].
    """
    (q, tool), (name, far) = made, moved
    return [
        Row(
            {f"expected_{name}_mm": float(MM * far[k])},
            q_shown=arm.to_display_units(q[k]).tolist(),
            expected_error_mm=float(MM * forecast.rms_error[k]),
            expected_error_p05_mm=float(MM * forecast.percentile_5[k]),
            expected_error_p95_mm=float(MM * forecast.percentile_95[k]),
            tool_m=tool[k].tolist(),
        )
        for k in range(len(q))
    ]


def _measured(made: Planned, moved: tuple[str, Array]) -> list[Row]:
    """The poses of the plan, how far it is to each, and whether the straight way is free."""
    arm, q = made.cell.arm, made.plan.q
    slides = ~arm.hinges
    steps = np.abs(np.diff(q, axis=0, prepend=q[:1]))
    turned, slid = (steps[:, own].max(axis=1, initial=0.0) for own in (~slides, slides))
    ways = ["start", *("clear" if clear else "via" for clear in made.plan.clear_paths)]
    tools = evaluate_chain(made.cell.vjm, q).tool_position
    placed = _placed(made)
    return [
        Row(
            row | {key: words[k] for key, words in placed.items()},
            run=k + 1,
            q=arm.to_file_joints(q[k]).tolist(),
            travel_deg=float(np.rad2deg(turned[k])),
            travel_mm=float(MM * slid[k]),
            way=ways[k],
        )
        for k, row in enumerate(_poses(arm, (q, tools), made.poses, moved))
    ]


def _runs(made: Planned, plan: Plan) -> list[Row]:
    """The poses of a plan for tasks, and what hangs or pulls in each."""
    spec, masses = plan.specification, made.settings.loads_kg
    load = select_loads(spec, plan.load_index)
    moved = rms(deflection_rows(spec.setup, plan.q, load) @ spec.setup.scaling.expected_x)
    rows = _measured(made, ("deflection", moved))
    for row, index, wrench in zip(rows, plan.load_index, load.wrench, strict=True):
        pulls = index >= len(masses)  # they come behind all that hangs
        row["load_kg"] = 0.0 if pulls else float(masses[index])
        row["pull_N"] = wrench[:3].tolist() if pulls else None
        row["load"] = pull_words(row.pull_N) if pulls else f"{row.load_kg:g} kg"
    return rows


def _tasks(made: Planned, plan: Plan, moved: Array) -> list[Row]:
    tasks, vjm = plan.specification.tasks, made.cell.vjm
    wrench, point = (np.broadcast_to(x, (len(tasks.q), x.shape[-1])) for x in vars(tasks.load).values())
    at = tasks.q, evaluate_chain(vjm, tasks.q).tool_position
    return [
        Row(
            row,
            task=k + 1,
            force_N=wrench[k, :3].tolist(),
            moment_Nm=wrench[k, 3:].tolist(),
            point_m=point[k].tolist(),
        )
        for k, row in enumerate(_poses(vjm.arm, at, made.forecast, ("deflection", moved)))
    ]


def _directions(plan: Plan, influence: PriorInfluence) -> Row:
    """Unknowns, what loads can show of them, and what rests on the prior."""
    spec, problem = plan.specification, plan.candidates.problem
    believed = spec.prior_uncertainty is not None
    return Row(
        unknowns=spec.setup.scaling.structure.n_parameters,
        shown=problem.n_directions,
        seen=observability(problem, plan.chosen_indices).seen,
        outweighed=influence.directions_from_readings if believed else problem.n_directions,
        hidden_mm=MM * math.sqrt(influence.unobservable_mean_square),
        prior_share_percent=100 * influence.prior_share if believed else 0.0,
    )


def _count(poses: int, greedy: float | None, random: Sequence[float | None]) -> Row:
    """Errors of other plans of so many poses: of the greedy one, of random ones median and tenths [mm]."""
    return Row(zip(CURVE.split(), (poses, greedy, *random), strict=True))


def _advice(greedy: Array) -> Row:
    """Fewest poses that reach the target, and from where on more always bring little.

    Args:
        greedy: Errors at the tasks with 1, 2, ... poses, each the best next one, [mm].
    """
    reached = np.flatnonzero(greedy <= TARGET)
    ahead = np.r_[greedy[MORE:], np.full(MORE, np.inf)]
    with np.errstate(invalid="ignore"):
        pays = np.isinf(greedy) | (ahead <= (1 - LITTLE) * greedy)
    judged = len(greedy) - MORE
    last = np.flatnonzero(pays[:judged])
    enough = int(last[-1]) + 2 if len(last) else 1
    return Row(
        target_mm=TARGET,
        fewest=int(reached[0]) + 1 if len(reached) else None,
        examined_up_to=len(greedy),
        more=MORE,
        little_percent=100 * LITTLE,
        enough=enough if enough <= judged else None,
    )


def _percentile(errors: Array, percent: float) -> float | None:
    """A percentile of errors [m] of which some may be infinite, [mm]."""
    return finite(MM * float(np.percentile(errors, percent, method="lower")))


def _absolute(made: AbsolutePlanned) -> Row:
    """What only a plan of absolute readings has."""
    arm = made.cell.arm
    union = made.union
    plan = made.plan
    q = made.q
    asked = made.settings.poses
    rng, problem = trial_rng(made.settings.seed, 3), plan.candidates.problem
    criterion, error = (
        LinearCriterion(mean_square_weight(made.wanted @ problem.lift)),
        prediction_error_function(problem, made.wanted),
    )
    middle, low, _ = _random(made, error, asked, rng)
    scale = scale_forecast(made) if union.readings_by_kind else None
    counts = sorted({asked, *(count for count in COUNTS if count <= max(2 * asked, COUNTS[1]))})
    order = greedy_plan(problem, criterion, problem.rows, counts[-1])
    workspace_poses = places_at(arm, q, tool_poses(made.cell.vjm, q)[0], absolute.sag(union, q))
    return Row(
        model=union.unknowns.structure.name,
        prior=cad_prior(arm).name,
        targets=list(union.pose_readings.markers),
        unknowns=_counts(made),
        beyond_mm=MM * float(np.sqrt(np.square(absolute.unmodelled_displacement(union, q)).mean())),
        random_plans=Row(plans=CHANCE, median_mm=middle, best_tenth_mm=low),
        before_mm=None
        if made.given is None
        else MM * absolute.prior_error_after_alignment(union, made.wanted),
        filled=[] if made.given is None else list(joint_coverage(arm, made.given.calibration.series, plan.q)),
        plan=_measured(made, ("sag", absolute.sag(union, plan.q))),
        scale=scale,
        hidden=_hidden(made, scale),
        curve=[_count(k, MM * error(order[:k]), _random(made, error, k, rng)) for k in counts],
        map=error_places(workspace_poses, {CALIBRATED: MM * made.forecast.rms_error}, means=POSITION),
    )


def _hidden(made: AbsolutePlanned, scale: Row | None) -> list[str]:
    """Say what the plan leaves unknown."""
    if made.given is not None:
        return []
    if scale is None:
        return list(undetermined_by(made.union, made.plan.q))
    said = []
    if scale.after_mm_per_m > HIDDEN_SCALE * scale.before_mm_per_m:
        said.append(
            f"The scale of the arm remains uncertain by {scale.after_mm_per_m:.2f} mm per metre, "
            f"which alone causes an error of {scale.error_mm:.3f} mm. Parallel faces of one block, a bar or "
            "positions determine it"
        )
    normals = made.union.unknowns.plane_normals
    if any(np.linalg.matrix_rank(own) < len(own[0]) for own in normals.values()):
        said.append("Where the base is along a plane, and how it is turned about the plane's normal")
    return said


def _counts(made: AbsolutePlanned) -> Row:
    """How many unknowns there are of each kind, and how many directions so many poses can see."""
    row = Row()
    for (name, start), (_, end) in pairwise(made.union.unknowns.first_columns.items()):
        kind = name.split()[0]
        row[kind] = row.get(kind, 0) + end - start
    return Row(row, seen=made.plan.candidates.problem.n_directions)


def _random(
    made: AbsolutePlanned, error: Callable[[Ids], float], poses: int, rng: np.random.Generator
) -> list[float]:
    """Errors of random plans of the drawn candidates: median, best and worst tenth [mm]."""
    drawn = len(made.found.q)
    plans = [rng.choice(drawn, poses, replace=drawn < poses) for _ in range(CHANCE)]
    return [float(x) for x in MM * np.percentile([error(plan) for plan in plans], [50, 10, 90])]


BINS = 72  #: Ranges of a joint: 5 degrees each of a hinge that turns once.


def joint_coverage(arm: Arm, series: Sequence[Series], q: Array) -> Iterator[Row]:
    """Compute, for every joint, the part of its range without a reading, and count the poses in that part.

    A range goes from limit to limit, or over a turn of a hinge that turns farther.

    Args:
        arm: Description of the arm.
        series: Series of absolute readings.
        q: Poses, (poses, n) [rad, m].

    Yields:
        A row per joint.
    """
    measured = np.concatenate([one.q[one.is_measured.any(axis=1)] for one in series])
    for j, joint in enumerate(arm.joints):
        ends, own = (joint.lower, joint.upper), (measured[:, j], q[:, j])
        if not joint.prismatic and joint.upper - joint.lower > 2 * np.pi:
            ends, own = (0.0, 2 * np.pi), (own[0] % (2 * np.pi), own[1] % (2 * np.pi))
        read, planned = (np.histogram(np.clip(x, *ends), BINS, ends)[0] for x in own)
        unread = read == 0
        poses = int(planned[unread].sum())
        yield Row(joint=joint.name, unread_percent=100 * float(unread.mean()), poses=poses)


def _placed(made: Planned) -> dict[str, list[str]]:
    """Name what each pose is read with: gauges, such as "P1:z P2:x", or the face that it touches."""
    if isinstance(made.plan, Plan) and made.plan.gauges is not None:
        markers, gauges = made.cell.arm.markers, made.plan.gauges
        pairs = zip(gauges.marker.tolist(), gauges.axis.tolist(), strict=True)
        return {
            "gauges": [
                " ".join(f"{markers[m]}:{'xyz'[a]}" for m, a in zip(*own, strict=True)) for own in pairs
            ]
        }
    kinds = made.union.readings_by_kind if isinstance(made, AbsolutePlanned) else ()
    if kinds and kinds[0][0].plane_normal is not None:
        return {"face": [kinds[k][0].name for k in made.plan.load_index]}
    return {}


def write_poses(f: Row, joints: Sequence[ArmJoint], path: Path) -> None:
    """Write plan.csv, a row for each run in the order of measuring.

    run: integer. JOINT_rad, JOINT_deg: joint angle, in rad to the last digit, and in degrees; of a slide
    JOINT_m, JOINT_mm. load_kg: hung mass. force_*_N, of a plan that may pull: force at the load point, world
    axes; a run has either, the other is blank.
    expected_deflection_mm: RMS over the markers, by the prior. expected_error_*_mm: of predicting it after
    identification, with the 5th and 95th percentile. travel_deg: of the hinge that turns farthest from the
    run before; travel_mm: of the slide, where the arm has one. way: "start", "clear" where all joints can go
    straight, "via" where that way collides. gauges, of a plan with gauges: marker and world axis of each.

    Of absolute readings load_kg is of one mass that hangs after the first reading of every pose, if there is
    one; expected_sag_mm: RMS over the targets, by the prior, under all that hangs; expected_error_*_mm: of
    their positions after calibration. face, of a plan with planes: name of the one that the pose touches.

    Args:
        f: Numbers of the plan.
        joints: Joints of the arm.
        path: Path of the file.
    """
    moved = "sag" if f.absolute else "deflection"
    head = ["run", *(j.file_column for j in joints), *(j.display_column for j in joints)]
    head += ["load_kg"] * (not f.absolute or len(f.loads_kg) == 1)
    head += [f"force_{axis}_N" for axis in "xyz" if f.pulls_n]
    head += [f"expected_{what}_mm" for what in (moved, "error", "error_p05", "error_p95")]
    head += ["travel_deg", *["travel_mm"] * any(j.prismatic for j in joints), "way"]
    head += [key for key in ("gauges", "face") if key in f.plan[0]]
    rows = []
    for row in f.plan:
        force = row.get("pull_N")
        mass = "" if force else repr(row.get("load_kg", f.loads_kg[0] if f.loads_kg else 0.0))
        cells = {**row, "load_kg": mass}
        cells |= zip((f"force_{axis}_N" for axis in "xyz"), map(repr, force or []), strict=False)
        cells |= {key: f"{row[key]:.2f}" for key in ("travel_deg", "travel_mm")}
        cells |= _cells(row, joints)
        cells |= {joint.file_column: repr(x) for joint, x in zip(joints, row.q, strict=True)}
        rows.append(cells)
    _write_table(head, rows, path)


def write_tasks(f: Row, joints: Sequence[ArmJoint], path: Path) -> None:
    """Write tasks_expected.csv: the pose and the expected error of every task.

    Args:
        f: Numbers of the plan.
        joints: Joints of the arm.
        path: Path of the file.
    """
    rows = [{"task": row.task, **_cells(row, joints)} for row in f.tasks]
    _write_table(list(rows[0]), rows, path)


def _cells(row: Row, joints: Sequence[ArmJoint]) -> dict[str, str]:
    """Joints in deg or mm, and what is expected of a pose."""
    shown = {joint.display_column: f"{x:.4f}" for joint, x in zip(joints, row.q_shown, strict=True)}
    return shown | {key: f"{x:.4f}" for key, x in row.items() if key.startswith("expected_")}


def _write_table(head: Sequence[str], rows: Sequence[Mapping[str, object]], path: Path) -> None:
    with path.open("w", encoding="utf-8", newline="") as file:
        table = csv.DictWriter(file, head, restval="", extrasaction="ignore", lineterminator="\n")
        table.writeheader()
        table.writerows(rows)
