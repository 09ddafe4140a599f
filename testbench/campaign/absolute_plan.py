"""The composer of a plan of absolute readings: from what is asked for to poses and what they promise."""

from dataclasses import dataclass, replace

import numpy as np

from testbench.arm.mjcf import GRAVITY
from testbench.campaign.campaign import Cell, stream
from testbench.campaign.plan import Planned, around, reach_of, search
from testbench.campaign.plan_settings import PlanSettings, structure
from testbench.campaign.rows import MM, UM
from testbench.data.series import Series, select_rows
from testbench.design import absolute
from testbench.design.absolute import Sizes, Union
from testbench.design.planning import Search, choose
from testbench.errors import Array, BenchError
from testbench.identify.absolute.pull import pull_of
from testbench.identify.absolute.seen import LOOSE, hidden
from testbench.identify.absolute.seen_words import sentences
from testbench.identify.absolute.state import Frame, Mount, nominal
from testbench.identify.absolute.unknowns import unknowns_of
from testbench.identify.metric import metric
from testbench.identify.prior import cad_prior
from testbench.model.joint_errors import JointErrors
from testbench.model.vjm import Vjm
from testbench.model.weights import read_weights

FRAME, MOUNT = "tracker", "target"  #: Names of what is unknown of the set-up.


@dataclass(frozen=True)
class AbsolutePlanned(Planned):
    """A plan of absolute readings and what it promises."""

    union: Union  #: What is unknown.
    q: Array  #: Poses over which it is judged, (poses, n) [rad, m].
    wanted: Array  #: Predictions there, `absolute.position_rows`.


def plan_absolute(cell: Cell, settings: PlanSettings) -> AbsolutePlanned:
    """The poses whose absolute readings calibrate an arm best, and what they promise.

    Raises:
        BenchError: When the arm has no joints or no such model.
        PoseError: When there are fewer feasible poses than the plan needs.
        InputError: When rigid.xml does not say what links weigh.
    """
    if not cell.arm.joints:
        raise BenchError(f"{cell.arm.name}: expected an arm with joints")
    union, found, q = union_of(cell, settings), search(cell, settings), around(cell, settings)
    wanted = absolute.position_rows(union, q)
    examined = absolute.candidate_set(union, found.q, settings.poses)
    looked = Search(
        measured=lambda q, _load: absolute.measured_rows(union, q),
        poses=settings.poses,
        limits=cell.arm.limits,
        reach=reach_of(cell, settings),
        rng=stream(settings.seed, 1),
    )
    best = choose(looked, absolute.criterion_of(settings.criterion, examined.problem, wanted), examined)
    there, over = (absolute.promise(best, rows) for rows in (absolute.position_rows(union, best.q), wanted))
    return AbsolutePlanned(cell, settings, found, best, there, over, over, union, q, wanted)


def union_of(cell: Cell, settings: PlanSettings) -> Union:
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
    assert settings.uncertainty_percent is not None
    own = metric(prior, vjm, unknowns.structure)
    L = absolute.expected_root(unknowns, sizes, own, settings.uncertainty_percent / 100)
    hinges = np.array([not joint.prismatic for joint in cell.arm.joints])
    return Union(unknowns, state, L, pose, np.where(hinges, settings.rest_urad / UM, 0.0))


def one_pose(vjm: Vjm, settings: PlanSettings) -> Series:
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


def left_open(union: Union, q: Array) -> tuple[str, ...]:
    """What poses (poses, n) [rad, m] leave unknown, in words."""
    once = absolute.at(replace(union, pose=select_rows(union.pose, np.arange(1))), q)
    pull = pull_of(
        union.unknowns, union.state, (once,), lambda series: absolute.information_of(union, series.q)
    )
    tells, prior = absolute.information_of(union, q), union.L @ union.L.T
    set_up = union.unknowns.starts["geometry"]
    prior[:set_up, :set_up] = LOOSE**2 * np.eye(set_up)
    return sentences(hidden(union.unknowns, tells, prior, pull))
