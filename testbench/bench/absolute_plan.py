"""The composer of a plan of absolute readings: from what is asked for to poses and what they promise."""

from dataclasses import dataclass, replace

import numpy as np

from testbench.arm.mjcf import GRAVITY
from testbench.bench.absolute_plan_report import AbsolutePlanReport
from testbench.bench.absolute_plan_settings import AbsolutePlanSettings
from testbench.bench.absolute_plan_summary import Judged, summary
from testbench.bench.campaign import Cell, stream
from testbench.bench.candidates import Candidates, Conditions, build_checks, feasible, find
from testbench.bench.plan import WORKSPACE, nearest_turn, straight_way
from testbench.bench.plan_settings import structure
from testbench.bench.rows import MM, UM
from testbench.data.series import Series
from testbench.design import absolute
from testbench.design.absolute import Sizes, Union
from testbench.design.forecast import Forecast
from testbench.design.planning import Chosen, Search, choose
from testbench.design.refine import Reach
from testbench.errors import Array, BenchError
from testbench.identify.absolute.state import Frame, Mount, nominal
from testbench.identify.absolute.unknowns import unknowns_of
from testbench.identify.metric import metric
from testbench.identify.prior import cad_prior
from testbench.model.joint_errors import JointErrors
from testbench.model.vjm import Vjm
from testbench.model.weights import read_weights

FRAME, MOUNT = "tracker", "target"  #: Names of what is unknown of the set-up.


@dataclass(frozen=True)
class AbsolutePlanned:
    """A plan and what it promises."""

    found: Candidates  #: Feasible poses, and what it took to find them.
    chosen: Chosen  #: The poses, in the order of measuring.
    workspace: Array  #: Poses over which it is judged, (poses, n) [rad, m].
    forecast: Forecast  #: Errors there [m].
    report: AbsolutePlanReport  #: What was asked for, and what readers see.


def plan_absolute(cell: Cell, settings: AbsolutePlanSettings) -> AbsolutePlanned:
    """The poses whose absolute readings calibrate an arm best, and what they promise.

    Raises:
        BenchError: When the arm has no joints or no such model.
        PoseError: When there are fewer feasible poses than the plan needs.
        InputError: When rigid.xml does not say what links weigh.
    """
    if not cell.arm.joints:
        raise BenchError(f"{cell.arm.name}: expected an arm with joints")
    union, found, workspace = union_of(cell, settings), search(cell, settings), around(cell, settings)
    wanted = absolute.position_rows(union, workspace)
    chosen = choose_poses(cell, settings, union, found.q, wanted)
    forecast = absolute.promise(chosen, wanted)
    report = summary(cell, settings, Judged(union, found, chosen, workspace, wanted, forecast))
    return AbsolutePlanned(found, chosen, workspace, forecast, report)


def search(cell: Cell, settings: AbsolutePlanSettings) -> Candidates:
    """Feasible poses; PoseError where there are fewer than the plan needs."""
    checks = build_checks(cell, settings.conditions)
    found = find(checks, settings.candidates_wanted, stream(settings.seed, 0), least=settings.poses)
    return replace(found, q=nearest_turn(found.q, cell.arm))


def around(cell: Cell, settings: AbsolutePlanSettings) -> Array:
    """Poses that stand for the workspace, (poses, n) [rad, m]."""
    checks = build_checks(cell, Conditions(settings.area))
    return find(checks, WORKSPACE, stream(settings.seed, 2), least=1).q


def choose_poses(cell: Cell, settings: AbsolutePlanSettings, union: Union, q: Array, wanted: Array) -> Chosen:
    """The best poses found from candidates (candidates, n) [rad, m]; wanted are rows of predictions."""
    checks = build_checks(cell, settings.conditions)
    examined = absolute.candidate_set(union, q, settings.poses)
    search = Search(
        measured=lambda q, _load: absolute.measured_rows(union, q),
        poses=settings.poses,
        limits=cell.arm.limits,
        reach=Reach(lambda q: feasible(checks, q), straight_way(cell, settings.station)),
        rng=stream(settings.seed, 1),
    )
    return choose(search, absolute.criterion_of(settings.criterion, examined.problem, wanted), examined)


def union_of(cell: Cell, settings: AbsolutePlanSettings) -> Union:
    """What is unknown where a tracker reads an arm absolutely."""
    pose, vjm = one_pose(cell.vjm, settings), cell.vjm
    unknowns = unknowns_of(
        vjm, (pose,), JointErrors(tuple(range(1, settings.orders + 1))), structure(cell, settings.model)
    )
    prior, n = cad_prior(cell.arm), cell.arm.n_joints
    state = replace(
        nominal(vjm, read_weights(cell.arm), np.ones(n)),
        C_theta=prior.C_theta,
        errors=unknowns.errors,
        n=np.zeros((n, unknowns.errors.size)),
        frames={FRAME: Frame(np.eye(3), np.zeros(3))},
        mounts={MOUNT: Mount(vjm.markers[: len(pose.markers)], np.eye(3), pose.markers)},
    )
    sizes = Sizes(
        shift=settings.geometry_mm / MM, turn=settings.geometry_mm / MM, error=settings.gear_urad / UM
    )
    own = metric(prior, vjm, unknowns.structure)
    L = absolute.expected_root(unknowns, sizes, own, settings.uncertainty_percent / 100)
    hinges = np.array([not joint.prismatic for joint in cell.arm.joints])
    return Union(unknowns, state, L, pose, np.where(hinges, settings.rest_urad / UM, 0.0))


def one_pose(vjm: Vjm, settings: AbsolutePlanSettings) -> Series:
    """How a pose is read: under own weight, then under one load after the other."""
    masses = np.array([0.0, *settings.loads_kg])
    rows = len(masses)
    markers = vjm.arm.markers[:1] if settings.orientations else vjm.arm.markers
    wrench = np.zeros((rows, 6))
    wrench[:, 2] = -GRAVITY * masses
    sigma = settings.sigma_um / UM
    return Series(
        name="plan",
        markers=markers,
        frame=FRAME,
        target=MOUNT,
        row=np.arange(rows),
        pose=np.zeros(rows, dtype=int),
        q=np.zeros((rows, vjm.arm.n_joints)),
        wrench=wrench,
        point=np.tile(vjm.load, (rows, 1)),
        position=np.zeros((rows, len(markers), 3)),
        sigma=sigma,
        rotation=np.tile(np.eye(3), (rows, 1, 1)) if settings.orientations else None,
        sigma_rotation=sigma if settings.orientations else None,
    )
