"""Settings of a plan: plain data with units in the names, as in plan.json, and flags that ask for them."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from numbers import Real
from pathlib import Path
from typing import Annotated

import typer

from testbench.design.criteria import check_criterion
from testbench.errors import BenchError, in_flags, of_flag, some_of
from testbench.files.read_pairs import SIGMA_RANGE
from testbench.identify.absolute.fit import CalibrationOptions as Fit
from testbench.identify.prior import UNCERTAINTY_RANGE
from testbench.model.structure import Structure
from testbench.model.vjm import WorkArea
from testbench.plant.rigid_cell import Payload
from testbench.plant.tracker import Station
from testbench.workflows.absolute import Calibrated, File, calibrate_with_masses, read_all
from testbench.workflows.cell import Cell
from testbench.workflows.instruments import Mounted, mounted
from testbench.workflows.models import ALL_UNKNOWNS, arm_model_names, canonical_name, named_models, plain_name
from testbench.workflows.options import ArmName, MapFile, mass, payload_of
from testbench.workflows.plan_input import (
    LOAD_RANGE,
    PULL_RANGE,
    Place,
    PoseConditions,
    parse_point,
    parse_work_area,
)
from testbench.workflows.rows import UM

HIGHEST = 1000.0  #: Height of a floor, up or down [m]; beyond it a unit is a slip.
MAX_POSES = 200
MAX_CANDIDATES = 50_000  #: Also times loads and pulls: memory grows with them.
HIGHEST_ORDER = 30  #: Of the periodic errors that joints have, as our true arms have.
MAX_GAUGES = 3  #: Gauges in a pose: more would make thousands of ways to place them.
MAX_ORDERS = 12  #: Of those that are unknowns of a plan.


@dataclass(frozen=True, kw_only=True)
class PlanSettings:
    """Describe the settings of a calibration plan, with units in the names."""

    #: Whether tracker frame, targets, geometry and joint errors are unknown too; a plan then has no tasks.
    absolute: bool = False
    given: tuple[str, ...] = ()  #: Names of files of earlier readings.
    #: Name of the model whose structure will be identified; "ALL" for all links and joints.
    model: str = ALL_UNKNOWNS
    criterion: str = "test"  #: One of `design.criteria.CRITERIA`; for absolute readings not "test".
    poses: int = 12  #: Number of poses to measure.
    #: Masses that may be hung. For absolute readings each of them is hung in turn, after a reading without a
    #: weight.
    loads_kg: tuple[float, ...] = ()
    #: Forces that may pull at the load point instead, world axes; a plan chooses a load for every pose.
    pulls_n: tuple[Place, ...] = ()
    orientations: bool = False  #: Whether the orientation of one target is read.
    #: Instruments of distances or heights instead of a tracker, as `instruments.mounted` reads them.
    instruments: tuple[str, ...] = ()
    #: Standard deviation of one reading along one axis [um]; of an orientation about one axis [urad].
    sigma_um: float = 50.0
    #: Relative uncertainty of the CAD prior [%]; None for an identification without a prior.
    uncertainty_percent: float | None = 30.0
    geometry_mm: float = 1.0  #: Expected error of geometry along an axis [mm], and about an axis [mrad].
    gear_urad: float = 30.0  #: Expected coefficient of a joint's periodic error, up to order 30.
    orders: int = 3  #: Number of orders that are identified; the others count as noise of a pose.
    tracker_m: Place | None = None  #: Position of the tracker, world [m]; None leaves visibility unchecked.
    #: Half angle in which fixed targets return the beam; None for targets turned by hand.
    acceptance_deg: float | None = None
    #: Lower and upper corner of the tool's area [m]; None for anywhere.
    box_m: tuple[Place, Place] | None = None
    sling_m: float = 0.5  #: Distance from the load point to the weight [m].
    candidates_wanted: int = 5000  #: Feasible poses to choose from.
    floor_z_m: float | None = None  #: Height of a floor that the arm's folder does not have.
    gauges: int = 0  #: Number of gauges that are read in a pose instead of a tracker; 0 for a tracker.
    gauge_um: float = 5.0  #: Standard deviation of one reading of a gauge [um].
    tilt_deg: float = 0.5  #: Standard deviation of a gauge's direction about each axis across it [deg].
    seed: int = 1  #: Root of all randomness.

    def __post_init__(self) -> None:
        check_criterion(self.criterion, for_absolute_readings=self.absolute)
        self._check_loads()
        self._check_instruments()
        doubled = 1 if self.absolute else 2  # of deflections it is doubled for doubters
        ranges: tuple[tuple[str, float | None, float, float], ...] = (
            ("poses", self.poses, 1, MAX_POSES),
            ("candidates_wanted", self.candidates_wanted, self.poses, MAX_CANDIDATES),
            ("sigma_um", self.sigma_um, UM * SIGMA_RANGE[0], UM * SIGMA_RANGE[1]),
            (
                "uncertainty_percent",
                self.uncertainty_percent,
                100 * UNCERTAINTY_RANGE[0],
                100 / doubled * UNCERTAINTY_RANGE[1],
            ),
            ("geometry_mm", self.geometry_mm, 1e-6, 100),
            ("gear_urad", self.gear_urad, 1e-6, 1e5),
            ("orders", self.orders, 0, MAX_ORDERS),
            ("floor_z_m", self.floor_z_m, -HIGHEST, HIGHEST),
            ("acceptance_deg", self.acceptance_deg, 0.1, 90),
            ("sling_m", self.sling_m, 0, 100),
            ("gauges", self.gauges, 0, 0 if self.absolute else MAX_GAUGES),
            ("gauge_um", self.gauge_um, UM * SIGMA_RANGE[0], UM * SIGMA_RANGE[1]),
            ("tilt_deg", self.tilt_deg, 0, 10),
            ("seed", self.seed, 0, 2**63 - 1),
        )
        for own in ranges:
            _check_range(*own)
        if self.acceptance_deg is not None and self.tracker_m is None:
            raise BenchError("acceptance_deg: expected the position of a tracker too")
        if self.box_m is not None and not all(a < b for a, b in zip(*self.box_m, strict=True)):
            corners = [f"{x:g}" for corner in self.box_m for x in corner]
            raise BenchError(f"box_m: expected the lower corner first, got {', '.join(corners)}")

    def _check_loads(self) -> None:
        loads, pulls = self.loads_kg, self.pulls_n
        for name, values in (("loads_kg", loads), ("pulls_n", pulls)):
            if not isinstance(values, list | tuple):
                raise BenchError(f"{name}: expected a tuple, got {type(values).__name__}")
        if len(set(loads)) < len(loads) or not (loads or self.absolute):
            least = "" if self.absolute else "one or more "
            raise BenchError(
                f"loads_kg: expected {least}different loads, got {some_of(f'{load:g}' for load in loads)}"
            )
        if len(set(pulls)) < len(pulls):
            raise BenchError(f"pulls_n: expected different pulls, got {some_of(pulls)}")
        for load in loads:
            _check_range("loads_kg", load, *LOAD_RANGE)
        for pull in pulls:
            _check_range("pulls_n, its size", math.hypot(*pull), *PULL_RANGE)
        every = self.candidates_wanted * (1 if self.absolute else len(loads) + len(pulls))
        _check_range("loads_kg and pulls_n, times candidates_wanted", every, 1, MAX_CANDIDATES)

    def _check_instruments(self) -> None:
        if not self.instruments:
            return
        if not self.absolute:
            raise BenchError("instruments are only for --absolute; plan gauges with --gauges")
        others = {"tracker_m": self.tracker_m, "orientations": self.orientations, "given": self.given}
        if named := [name for name, own in others.items() if own]:
            raise BenchError(f"instruments: cannot be combined with {named[0]}")
        if any(own.fixed is None for own in self.mounted):
            raise BenchError("instruments: expected ballbar, bar, wire or plane")

    @property
    def mounted(self) -> tuple[Mounted, ...]:
        """Return the instruments that read distances or heights."""
        return tuple(map(mounted, self.instruments))

    @property
    def station(self) -> Station | None:
        """Return the tracker; None if its place is not stated."""
        if self.tracker_m is None:
            return None
        half = None if self.acceptance_deg is None else math.radians(self.acceptance_deg)
        return Station(self.tracker_m, acceptance_angle=half)

    @property
    def area(self) -> WorkArea | None:
        """Return the tool's area; None for anywhere."""
        return None if self.box_m is None else WorkArea(*self.box_m)

    @property
    def conditions(self) -> PoseConditions:
        """Return the conditions of a pose under the largest load, whose weight is the largest solid."""
        payload = Payload(max(self.loads_kg), self.sling_m) if self.loads_kg else None
        return PoseConditions(self.area, self.station, payload)


USUAL = {
    True: {"criterion": "I", "poses": 50, "candidates_wanted": 1000},
    False: {"criterion": "test", "poses": 12, "candidates_wanted": 5000},
}
"""What is asked for where nothing is said, of a plan of absolute readings and of one for tasks."""
TOUCHES = 400  #: Candidates that touch planes, where nothing is said: poses on a face take long to find.


def pull_words(pull: Sequence[float]) -> str:
    """Name a pull, world axes [N], as plans do."""
    along = [(f"{abs(x):g} N along {'-' * (x < 0)}{axis}") for x, axis in zip(pull, "xyz", strict=True) if x]
    return f"pull of {along[0]}" if len(along) == 1 else f"pull {', '.join(f'{x:g}' for x in pull)} N"


def _check_range(what: str, value: float | None, low: float, high: float) -> None:
    if not isinstance(value, Real | None):
        raise BenchError(f"{what}: expected a number, got {type(value).__name__}")
    if value is not None and not low <= value <= high:  # false for NaN
        raise BenchError(f"{what}: expected {low:g} to {high:g}, got {value:g}")


def structure(cell: Cell, name: str) -> Structure:
    """Return the structure of an arm's model.

    Args:
        cell: The arm.
        name: Name of the model.

    Returns:
        The structure.

    Raises:
        BenchError: If the arm has no such model, or the model depends on a dataset.
    """
    [model] = named_models(cell, [name])
    if not model.structure.has_full_blocks:
        others = ", ".join(other for other in arm_model_names(cell) if other != name)
        raise BenchError(
            f"no plan for {name}, because its unknowns depend on the readings; expected one of {others}"
        )
    return model.structure


@dataclass(frozen=True)
class PlanOptions:
    """Hold the flags of `testbench plan`, in the units of the command line."""

    arm: ArmName
    task: Annotated[
        Path | None, typer.Option(metavar="CSV", help="Poses and forces of the robot's task.")
    ] = None
    load: Annotated[
        list[float] | None,
        typer.Option(parser=mass, metavar="MASS", help="Hung mass: 240 or 530lb; repeat to offer several."),
    ] = None
    pull: Annotated[
        list[str] | None, typer.Option(metavar="X,Y,Z", help="Force instead of a weight, N; repeatable.")
    ] = None
    poses: Annotated[
        int | None, typer.Option(metavar="N", help="Number of poses (default: 12, or 50 if absolute).")
    ] = None
    mapping: MapFile = None
    tracker: Annotated[str | None, typer.Option(metavar="X,Y,Z", help="Position of the tracker, m.")] = None
    acceptance_deg: Annotated[
        float | None, typer.Option(metavar="DEG", help="Half angle in which fixed targets reflect.")
    ] = None
    box: Annotated[
        str | None, typer.Option(metavar="X0,...,Z1", help="Corners of the box for the tool, m.")
    ] = None
    criterion: Annotated[str | None, typer.Option(metavar="NAME", help="test, D, A, E, G or I.")] = None
    model: Annotated[str | None, typer.Option(metavar="NAME", help="Model that will be identified.")] = None
    sigma_um: Annotated[float, typer.Option(metavar="UM", help="Noise of a reading along an axis.")] = 50.0
    uncertainty_percent: Annotated[
        float | None, typer.Option(metavar="PERCENT", help="Uncertainty of the prior (default: 30).")
    ] = None
    no_prior: Annotated[bool, typer.Option("--no-prior", help="Plan for a fit without a prior.")] = False
    candidates: Annotated[int | None, typer.Option(metavar="N", help="Number of candidate poses.")] = None
    sling_m: Annotated[float, typer.Option(metavar="M", help="Length from load point to weight.")] = 0.5
    floor_z: Annotated[float | None, typer.Option(metavar="M", help="Height of a floor.")] = None
    gauges: Annotated[
        int, typer.Option(metavar="N", help="Number of gauges per pose, 1 to 3, to be placed.")
    ] = 0
    gauge_um: Annotated[float, typer.Option(metavar="UM", help="Noise of a gauge.")] = 5.0
    tilt_deg: Annotated[float, typer.Option(metavar="DEG", help="Error of a gauge's direction.")] = 0.5
    seed: Annotated[int, typer.Option(metavar="N", help="Seed of random numbers.")] = 1


@dataclass(frozen=True)
class AbsolutePlanOptions:
    """Hold the flags of a plan of absolute readings."""

    absolute: Annotated[bool, typer.Option("--absolute", help="Plan absolute readings, without tasks.")] = (
        False
    )
    given: Annotated[
        list[Path] | None, typer.Option(metavar="CSV", help="Readings taken before; repeatable.")
    ] = None
    orientations: Annotated[
        bool, typer.Option("--orientations", help="Read one target's orientation too.")
    ] = False
    instrument: Annotated[
        list[str] | None,
        typer.Option(metavar="KIND:...", help="plane:P1:z:X,Y,Z, bar:P1:X,Y,Z, ...; repeatable."),
    ] = None
    geometry_mm: Annotated[float, typer.Option(metavar="MM", help="Expected geometric errors.")] = 1.0
    gear_urad: Annotated[float, typer.Option(metavar="URAD", help="Expected periodic joint errors.")] = 30.0
    orders: Annotated[int, typer.Option(metavar="N", help="Highest order of periodic errors.")] = 3


SAME = {field.name for field in fields(PlanSettings)} & {
    field.name for options in (PlanOptions, AbsolutePlanOptions) for field in fields(options)
}
"""Settings that are named as their flags."""
FLAGS = {
    **{name: f"--{name.replace('_', '-')}" for name in SAME},
    "candidates_wanted": "--candidates",
    "floor_z_m": "--floor-z [m]",
    "box_m": "--box [m]",
    "loads_kg": "--load [kg]",
    "pulls_n": "--pull",
    "pulls_n, its size": "--pull [N], its size",
    "instruments": "--instrument",
    "loads_kg and pulls_n, times candidates_wanted": "--load and --pull, times --candidates",
}
"""The flag of every field of `PlanSettings`, as errors name it."""


def known_before(cell: Cell, options: PlanOptions, flags: AbsolutePlanOptions) -> Calibrated | None:
    """Calibrate the arm by the readings of `--given`; None without any.

    Args:
        cell: The arm with its model and its truth.
        options: Flags of the command line.
        flags: Flags of absolute readings.

    Returns:
        The calibration; None without readings.
    """
    if not flags.given:
        return None
    files = [File(path, options.mapping, sigma_um=options.sigma_um) for path in flags.given]
    series, notes = read_all(files, cell.arm)
    return calibrate_with_masses(cell.vjm, series, Fit(), notes)


def settings_of(cell: Cell, options: PlanOptions, flags: AbsolutePlanOptions) -> PlanSettings:
    """Turn the flags into settings.

    Args:
        cell: The arm with its model and its truth.
        options: Flags of the command line.
        flags: Flags of absolute readings.

    Returns:
        The settings.

    Raises:
        BenchError: When two flags exclude each other, or one is out of range.
    """
    _check(options, flags)
    usual, loads = USUAL[flags.absolute], options.load or []
    if any(text.startswith("plane") for text in flags.instrument or ()):
        usual = usual | {"candidates_wanted": TOUCHES}
    wanted = {"criterion": options.criterion, "poses": options.poses, "candidates_wanted": options.candidates}
    chosen = {key: usual[key] if own is None else own for key, own in wanted.items()}
    if not flags.absolute:
        loads = loads or [payload_of(cell.arm, None, "--load")]
        with of_flag("--criterion"):
            check_criterion(str(chosen["criterion"]))
    with of_flag("--model"):
        model = canonical_name(
            cell, options.model or (plain_name(cell) if options.no_prior else ALL_UNKNOWNS)
        )
    percent = 30.0 if options.uncertainty_percent is None else options.uncertainty_percent
    with in_flags(FLAGS):
        flagged = {name: value for name, value in (vars(options) | vars(flags)).items() if name in SAME}
        derived = chosen | {"given": tuple(path.name for path in flags.given or ())}
        derived |= {"model": model, "uncertainty_percent": None if options.no_prior else percent}
        settings = PlanSettings(
            **flagged | derived,
            instruments=tuple(flags.instrument or ()),
            loads_kg=tuple(loads),
            pulls_n=tuple(parse_point(text, "--pull fx,fy,fz [N]") for text in options.pull or []),
            tracker_m=None if options.tracker is None else parse_point(options.tracker),
            box_m=None if options.box is None else parse_work_area(options.box),
            floor_z_m=options.floor_z,
        )
    if loads:
        with of_flag("--sling-m"):
            Payload(max(loads), settings.sling_m)
    return settings


def _check(options: PlanOptions, flags: AbsolutePlanOptions) -> None:
    """Refuse what excludes --absolute, and what excludes --no-prior."""
    mapping = None if flags.given else options.mapping
    others = {
        "--task": options.task,
        "--no-prior": options.no_prior,
        "--pull": options.pull,
        "--map": mapping,
    }
    if named := [flag for flag, given in others.items() if flags.absolute and given]:
        raise BenchError(f"{named[0]} cannot be combined with --absolute")
    if options.uncertainty_percent is not None and options.no_prior:
        raise BenchError("--uncertainty-percent cannot be combined with --no-prior")
