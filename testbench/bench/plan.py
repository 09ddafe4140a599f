"""The composer of a plan: what an engineer wishes becomes candidates, poses, and what they promise."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from testbench.arm.mjcf import GRAVITY
from testbench.bench.campaign import MODELS, Cell, named_models, stream
from testbench.bench.candidates import Candidates, Conditions, build_checks, feasible, find
from testbench.data.csvfile import SIGMA_RANGE
from testbench.data.station import Station
from testbench.design import planning
from testbench.design.baselines import Baselines, PriorInfluence, compare, doubt, prior_influence
from testbench.design.forecast import OUTSIDE, Forecast
from testbench.design.observability import Observability, observability
from testbench.design.planning import Plan
from testbench.design.refine import Reach
from testbench.design.rows import Experiment, Load, deflection_rows
from testbench.design.specification import Specification, Tasks, loads_of, task_rows, workspace_rows
from testbench.errors import Array, BenchError
from testbench.identify.metric import metric
from testbench.identify.prior import RANGE, cad_prior
from testbench.model.poses import WorkArea
from testbench.model.structure import Structure
from testbench.plant import Payload, build_site, contacts

LOAD_RANGE = (1e-3, 1e4)
"""Masses that can hang from an arm [kg], as in bench.Scenario."""
MOST_POSES, MOST_CANDIDATES = 200, 50_000
WORKSPACE = 200
"""Poses that stand for the workspace."""
STEP = math.radians(5)
"""Largest joint's step between collision checks on the way from pose to pose [rad]."""
NAMED = 5
"""Tasks that a message names; more are counted."""


@dataclass(frozen=True)
class Wish:
    """What an engineer asks for.

    Attributes:
        structure: Unknowns of the model that is to be identified, in whole blocks.
        tasks: Where the robot works, and under which load.
        loads: Masses that may be hung [kg].
        poses: How many are to be measured.
        criterion: Key of planning.CRITERIA.
        sigma: Standard deviation of one reading along one axis [m].
        uncertainty: Relative uncertainty of the CAD prior [1]; None for an identification without a prior.
        station: Where the tracker stands; None leaves visibility unchecked.
        area: Where the tool may be while it is measured; None for anywhere.
        sling: From the load point to the weight [m].
        candidates: Feasible poses to choose from.
        seed: Root of all randomness.
    """

    structure: Structure
    tasks: Tasks
    loads: tuple[float, ...]
    poses: int = 12
    criterion: str = "test"
    sigma: float = 50e-6
    uncertainty: float | None = 0.3
    station: Station | None = None
    area: WorkArea | None = None
    sling: float = 0.5
    candidates: int = 5000
    seed: int = 1

    def __post_init__(self) -> None:
        if self.criterion not in planning.CRITERIA:
            known = ", ".join(planning.CRITERIA)
            raise BenchError(f"no criterion {self.criterion!r}; criteria are {known}")
        if not self.loads or len(set(self.loads)) < len(self.loads):
            raise BenchError(f"loads [kg]: expected at least one, each once, got {list(self.loads)}")
        for load in self.loads:
            _check_range("load [kg]", load, *LOAD_RANGE)
        _check_range("poses", self.poses, 1, MOST_POSES)
        _check_range("candidates", self.candidates, self.poses, MOST_CANDIDATES)
        _check_range("sigma [m]", self.sigma, *SIGMA_RANGE)
        if self.uncertainty is not None:
            low, high = RANGE
            _check_range(
                "uncertainty of the prior [1]", self.uncertainty, low, high / 2
            )  # doubled for doubters


@dataclass(frozen=True)
class Planned:
    """A plan and what it promises.

    Attributes:
        wish: What was asked for.
        found: Feasible poses, and what it took to find them.
        specification: The same as planning wants it.
        plan: The poses, in the order of measuring.
        tasks: Errors at the tasks.
        poses: Errors in the plan's own poses.
        workspace: Errors over specification.workspace, under the first load.
        doubted: Errors at the tasks with a prior twice as uncertain; None without one.
        task_deflection: RMS over the targets in every task, by the prior, (tasks,) [m].
        deflection: The same in the plan's poses, (poses,) [m].
        clear: Whether the arm can go straight to each pose from the one before, (poses - 1,).
        baselines: Other plans.
        influence: What rests on the prior.
        observability: Indices of the plan.
    """

    wish: Wish
    found: Candidates
    specification: Specification
    plan: Plan
    tasks: Forecast
    poses: Forecast
    workspace: Forecast
    doubted: Forecast | None
    task_deflection: Array
    deflection: Array
    clear: tuple[bool, ...]
    baselines: Baselines
    influence: PriorInfluence
    observability: Observability


def structure(cell: Cell, name: str) -> Structure:
    """Unknowns of a model of `bench.MODELS`.

    Raises:
        BenchError: When there is no such model, the arm has too few links for it, or it lacks entries that a
            prior speaks of.
    """
    if name == "MLS32":
        whole = ", ".join(other for other in MODELS if other != name)
        raise BenchError(
            f"no plan for {name}: it leaves out entries by what one dataset shows; expected one of {whole}"
        )
    [model] = named_models(cell, [name])
    return model.structure


def hung(cell: Cell, mass: float) -> Load:
    """A mass that hangs from the arm's load point [kg]."""
    return Load(np.array([0, 0, -GRAVITY * mass, 0, 0, 0]), cell.vjm.load)


def search(cell: Cell, wish: Wish) -> Candidates:
    """Feasible poses under the largest of the loads: the others hang inside its outline.

    Args:
        cell: The arm.
        wish: What is asked for.

    Raises:
        PoseError: When there are fewer than the plan needs; says which condition refused them.
        BenchError: When the tracker stands inside the arm, or the sling is too short.
    """
    checks = build_checks(cell, _conditions(wish))
    found = find(checks, wish.candidates, stream(wish.seed, 0), least=wish.poses)
    return replace(found, q=nearest_turn(found.q, cell.arm.limits))


def nearest_turn(q: Array, limits: Array) -> Array:
    """The same poses with every joint in the turn nearest to zero that its limits allow, (poses, n) [rad].

    A joint that can turn about itself more than once reaches a pose at several angles; nearest to zero the
    ways from pose to pose are short, and cables are not wound up.

    Args:
        q: Joint angles within the limits, (poses, n) [rad].
        limits: Lower and upper joint limits, (2, n) [rad].
    """
    near = q - 2 * np.pi * np.round(q / (2 * np.pi))
    return np.where((near >= limits[0]) & (near <= limits[1]), near, q)


def specify(cell: Cell, wish: Wish) -> Specification:
    """The wish as planning wants it.

    Raises:
        BenchError: When the structure lacks entries in a block.
        PoseError: When the arm can be nowhere in the work area.
    """
    anywhere = find(build_checks(cell, Conditions(wish.area)), WORKSPACE, stream(wish.seed, 2), least=1)
    return Specification(
        experiment=Experiment(
            cell.vjm, metric(cad_prior(cell.arm), cell.vjm, wish.structure), cell.vjm.markers, wish.sigma
        ),
        loads=tuple(hung(cell, mass) for mass in wish.loads),
        tasks=wish.tasks,
        workspace=anywhere.q,
        uncertainty=wish.uncertainty,
        poses=wish.poses,
    )


def choose(cell: Cell, wish: Wish, specification: Specification, found: Candidates) -> Plan:
    """The best plan found.

    Args:
        cell: The arm.
        wish: What is asked for.
        specification: The same as planning wants it.
        found: Poses to choose from.

    Raises:
        BenchError: When without a prior the poses are too few, or tasks ask for what no load shows.
    """
    if wish.uncertainty is None:
        _check_without_prior(specification, found.q)
    checks = build_checks(cell, _conditions(wish))
    return planning.make_plan(
        specification,
        wish.criterion,
        found.q,
        Reach(lambda q: feasible(checks, q), straight_way(cell, wish.station)),
        stream(wish.seed, 1),
    )


def judge(cell: Cell, wish: Wish, specification: Specification, found: Candidates, plan: Plan) -> Planned:
    """What a plan promises, beside other plans from the same candidates.

    Raises:
        BenchError: When without a prior the plan leaves directions open that the candidates can show.
    """
    problem, rows, own = plan.examined.problem, task_rows(specification), _plan_rows(specification, plan)
    indices = observability(problem, plan.chosen)
    if wish.uncertainty is None and indices.seen < indices.of:
        raise BenchError(
            f"poses: {wish.poses} poses see {indices.seen} of the {indices.of} directions that these loads "
            "can show; give more --poses, or leave out --no-prior"
        )
    way, expected = straight_way(cell, wish.station), specification.experiment.metric.expected
    influence = prior_influence(plan, rows)
    legs = zip(plan.q[:-1], plan.q[1:], strict=True)
    return Planned(
        wish=wish,
        found=found,
        specification=specification,
        plan=plan,
        tasks=planning.promise(plan, rows),
        poses=planning.promise(plan, own),
        workspace=planning.promise(plan, workspace_rows(specification)),
        doubted=doubt(specification, plan, rows),
        task_deflection=_rms(rows @ expected),
        deflection=_rms(own @ expected),
        clear=tuple(way(a, b) for a, b in legs),
        baselines=compare(
            plan, specification, rows, drawn=len(found.q) * len(specification.loads), rng=stream(wish.seed, 3)
        ),
        influence=influence,
        observability=indices,
    )


def straight_way(cell: Cell, station: Station | None) -> Callable[[Array, Array], bool]:
    """Tells whether all joints can go straight from a pose to another, nothing hanging from the arm.

    Args:
        cell: The arm.
        station: Where the tracker stands, in the way of the arm.
    """
    site = build_site(cell.arm, None, None if station is None else station.position)

    def clear(start: Array, end: Array) -> bool:
        steps = max(1, math.ceil(float(np.abs(end - start).max()) / STEP))
        share = np.arange(1, steps)[:, None] / steps
        return all(contact is None for contact in contacts(site, start + share * (end - start)))

    return clear


def _conditions(wish: Wish) -> Conditions:
    return Conditions(wish.area, wish.station, Payload(max(wish.loads), wish.sling))


def _check_range(what: str, value: float, low: float, high: float) -> None:
    if not low <= value <= high:  # false for NaN
        raise BenchError(f"{what}: expected {low:g} to {high:g}, got {value:g}")


def _check_without_prior(specification: Specification, q: Array) -> None:
    """Refuse what only a prior could fill, before the search begins."""
    try:
        problem = planning.candidate_set(specification, q).problem
    except BenchError as err:
        raise BenchError(f"{err}: leave out --no-prior") from err
    rows = task_rows(specification)
    open_ = np.linalg.norm(rows @ problem.unseen, axis=(1, 2)) > OUTSIDE * np.linalg.norm(rows, axis=(1, 2))
    if open_.any():
        numbers = (np.flatnonzero(open_) + 1).tolist()
        named = ", ".join(map(str, numbers[:NAMED])) + (", ..." if len(numbers) > NAMED else "")
        raise BenchError(
            f"tasks {named} ({len(numbers)} of {len(rows)}): their loads move the arm in directions that "
            "these hung weights cannot show, so that the error has no bound; needed is a prior (leave out "
            "--no-prior) or a load in another direction"
        )


def _plan_rows(specification: Specification, plan: Plan) -> Array:
    """Deflections in the plan's poses per unit of x, (poses, 3 m, n) [m]."""
    return deflection_rows(specification.experiment, plan.q, loads_of(specification, plan.load))


def _rms(deflection: Array) -> Array:
    """RMS over the targets of every pose, (poses,), of deflections (poses, 3 m)."""
    return np.asarray(np.sqrt((deflection**2).sum(axis=1) / (deflection.shape[1] / 3)))
