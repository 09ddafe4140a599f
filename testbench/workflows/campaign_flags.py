"""Simulated campaigns: their flags, and the instruments around a cell that read them."""

import csv
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
import typer

from testbench.arm.folder import find_arm, load_arm
from testbench.data.dataset import Dataset, along_lines, join_rows, select_rows
from testbench.errors import Array, BenchError, Ids, InputError
from testbench.model.vjm import marker_positions, tool_points, tool_poses
from testbench.plant.tracker import (
    BALLBAR,
    DRAW_WIRE,
    LONG_BAR,
    DistanceMeter,
    Gauge,
    PlaneProbe,
    Tracker,
    read_orientations,
    read_positions,
)
from testbench.plant.true_arms import FAMILY, true_arms
from testbench.workflows.campaign import LoadedPoses, Scenario, Truth, of_arm, settle_both
from testbench.workflows.cell import Cell

if TYPE_CHECKING:
    from testbench.workflows.campaign import Pair


# --- Flags of simulated campaigns ---------------------------------------------------------------------------


def true_arm_name(text: str) -> str:
    """Check the name of a kind of true arm; BadParameter if there is none."""
    if text == FAMILY or text in true_arms:
        return text
    raise typer.BadParameter(f"expected one of {', '.join([FAMILY, *true_arms])}, got {text!r}")


ArmFlag = Annotated[str, typer.Option(metavar="ARM", help="Folder of an arm, or name of a built-in one.")]
TrueArmFlag = Annotated[
    str,
    typer.Option(parser=true_arm_name, metavar="NAME", help="Kind of true arm; family: one of six per seed."),
]


@dataclass(frozen=True)
class CampaignOptions:
    """Describe what a campaign under gravity is made from; a study adds its own flags."""

    arm: ArmFlag = "kr500_l480"
    payload_kg: Annotated[
        float | None, typer.Option(min=0.001, max=10_000, metavar="KG", help="Payload (default: rated).")
    ] = None
    sigma_um: Annotated[
        float, typer.Option(min=0.001, max=10_000, metavar="UM", help="Noise of a reading, per axis.")
    ] = 50.0
    truth: Annotated[Truth, typer.Option(help="MuJoCo's arm or a linear one.")] = "nonlinear"
    true_arm: TrueArmFlag = FAMILY

    def scenario(self, workspace_poses: int) -> Scenario:
        """Make the campaign that is asked for; InputError names an arm that there is not."""
        scenario = Scenario(
            arm=find_arm(self.arm).resolve().name,
            payload=self.payload_kg,
            sigma=self.sigma_um / 1e6,
            truth=self.truth,
            workspace_poses=workspace_poses,
        )
        return of_arm(load_arm(self.arm), scenario)


# --- Instruments around a cell: which of them read which marker, along which line, and what they read -------

CAMERA = Tracker(100e-6)
"""Photogrammetry of the whole cell; a tenth of a millimetre over some metres is usual [assumed]."""
PROBE = Tracker(50e-6, 5e-5)
"""A probe of six degrees of freedom: position as a tracker, orientation to about 0.003 degrees [assumed]."""


Instrument = Tracker | Gauge | DistanceMeter | PlaneProbe  #: What reads a marker.
SIZE = re.compile(r"([0-9.]{1,10})(um|mm|deg)")  #: Of an instrument: noise, unknown constant, or tilt.
BLOCK = re.compile(r"[A-Za-z][A-Za-z0-9_-]{0,39}")  #: Name of a block of faces.


@dataclass(frozen=True)
class Mounted:
    """Describe an instrument and what it reads."""

    instrument: Instrument
    marker: str = ""  #: Marker that it reads; "" for all, as trackers do.
    #: Direction that a gauge is said to have, world axes: one for all runs, (3,), or one each, (runs, 3) [1];
    #: zero in runs without the gauge.
    direction: Array | None = None
    on_tool: bool = False  #: Whether the direction is in the tool's axes, so that it turns with the pose.
    #: Where the fixed point of a distance meter is said to be, or a point of a plane, (3,) [m].
    fixed: Array | None = None
    block: str = ""  #: Name of the block of which a plane is a face; "" for a face alone.


KINDS: dict[str, Instrument] = {
    "tracker": Tracker(50e-6),
    "camera": CAMERA,
    "probe": PROBE,
    "gauge": Gauge(),
    "ballbar": BALLBAR,
    "bar": LONG_BAR,
    "wire": DRAW_WIRE,
    "plane": PlaneProbe(),
}
"""Instruments by name."""
AXES = {
    **dict(zip("xyz", np.eye(3), strict=True)),
    **{f"-{name}": -axis for name, axis in zip("xyz", np.eye(3), strict=True)},
}
"""Directions by name."""
PLANNED = "planned"  #: Instrument that stands for the gauges of a plan.
ON_TOOL = "tool_"  #: Before the name of a direction in the tool's axes.
FORMS = (
    "gauge:MARKER:z, ballbar:MARKER:X,Y,Z, the same of bar or wire, plane:MARKER:z:X,Y,Z or "
    "plane:MARKER:z:X,Y,Z:BLOCK, tracker, camera or probe, then :5um, :0.5deg or :1000mm"
)
"""Forms of an instrument's text."""


def mounted(text: str) -> Mounted:
    """Read an instrument from a text, such as "gauge:P1:z:5um:0.5deg" or "wire:P2:1.5,0,0.2".

    Args:
        text: Kind, marker, direction, fixed point in metres, name of the block of a plane, then sigma in um,
            an unknown constant of distances in mm, and a tilt in deg.

    Returns:
        The instrument.

    Raises:
        BenchError: When the text is none of an instrument.
    """
    kind, *parts = (part.strip() for part in text.split(":"))
    try:
        instrument = KINDS[kind]
        places = [part for part in parts if not SIZE.fullmatch(part)]
        for size in filter(None, map(SIZE.fullmatch, parts)):
            instrument = _with_size(instrument, float(size[1]), size[2])
        if isinstance(instrument, Tracker):
            [marker] = places or [""]
            return Mounted(instrument, marker)
        marker, *where = places
        direction, on_tool = None, False
        if isinstance(instrument, Gauge | PlaneProbe):
            name = where.pop(0)
            on_tool = name.startswith(ON_TOOL) and isinstance(instrument, Gauge)
            name = name.removeprefix(ON_TOOL) if on_tool else name
            direction = AXES[name] if name in AXES else _vector(name)
        fixed = None if isinstance(instrument, Gauge) else _vector(where.pop(0))
        block = where.pop(0) if where and isinstance(instrument, PlaneProbe) else ""
        if where or (block and not BLOCK.fullmatch(block)) or (direction is not None and not direction.any()):
            raise ValueError
    except (KeyError, ValueError, IndexError):
        raise BenchError(f"--instrument: expected {FORMS}, got {text[:80]!r}") from None
    return Mounted(instrument, marker, direction, on_tool, fixed, block)


def _vector(text: str) -> Array:
    """Read three finite numbers; ValueError for anything else."""
    vector = np.array([*map(float, text.split(","))])
    if vector.shape != (3,) or not np.isfinite(vector).all():
        raise ValueError
    return vector


def _with_size(instrument: Instrument, value: float, unit: str) -> Instrument:
    """Change noise in um, constant in mm or tilt in deg; ValueError for what the instrument does not have."""
    if unit == "um" and value > 0:
        return replace(instrument, sigma=value / 1e6)
    if unit == "mm" and isinstance(instrument, DistanceMeter):
        return replace(instrument, zero_sigma=value / 1e3)
    if unit == "deg" and isinstance(instrument, Gauge | PlaneProbe):
        return replace(instrument, tilt=math.radians(value))
    raise ValueError


def _planned_gauges(path: Path, markers: Sequence[str]) -> list[Mounted]:
    """Read the gauges of every pose of a plan, the column `gauges` of plan.csv.

    Args:
        path: The plan.
        markers: Those of the arm.

    Returns:
        One gauge per marker, with a direction in each pose where it is used.

    Raises:
        InputError: When there is no such column, or a cell names no marker and axis.
    """
    with path.open(encoding="utf-8", newline="") as file:
        cells = [row.get("gauges") for row in csv.DictReader(file)]
    direction = np.zeros((len(cells), len(markers), 3))
    for k, cell in enumerate(cells):
        for word in (cell or "").split():
            marker, _, axis = word.partition(":")
            if marker not in markers or axis not in AXES:
                problem = f"expected a marker and an axis such as {markers[0]}:z, got {word[:40]!r}"
                raise InputError(path, f"line {k + 2}, column gauges", problem)
            direction[k, markers.index(marker)] = AXES[axis]
    if not direction.any():
        raise InputError(path, "column gauges", "expected gauges, as `plan --gauges` writes them")
    used = [k for k in range(len(markers)) if direction[:, k].any()]
    return [Mounted(Gauge(), markers[k], direction[:, k]) for k in used]


def instruments(texts: Sequence[str], markers: Sequence[str], plan: Path | None, pose: Ids) -> list[Mounted]:
    """Read instruments from texts; "planned" stands for the gauges of a plan.csv.

    Args:
        texts: One per instrument, see `mounted`.
        markers: Those of the arm.
        plan: The plan; None without one.
        pose: Pose of every run, an index, (runs,).

    Returns:
        The instruments.

    Raises:
        BenchError: When a text is none of an instrument, or there is no plan.
    """
    found = list[Mounted]()
    for text in texts:
        if text != PLANNED:
            found.append(mounted(text))
        elif plan is None:
            raise BenchError(f"--instrument {PLANNED}: expected a plan.csv")
        else:
            gauges = _planned_gauges(plan, markers)
            found += [replace(own, direction=np.asarray(own.direction)[pose]) for own in gauges]
    return found


def read_instruments(
    cell: Cell, truth: Truth, loaded: LoadedPoses, mounted: Sequence[Mounted], rng: np.random.Generator
) -> Dataset:
    """Read the arm at rest, unloaded and loaded, with several instruments at once.

    Instruments that share a marker are read one after the other: then there are several runs per load.

    Args:
        cell: The arm.
        truth: Kind of truth.
        loaded: Poses and loads.
        mounted: The instruments.
        rng: Source of the instruments' errors.

    Returns:
        The runs: along lines, positions, or both; markers without an instrument are neither read nor lost.

    Raises:
        BenchError: When a marker is none of the arm's, or a probe of orientations is not the only instrument.
    """
    check_markers(cell, mounted)
    if any(isinstance(own.instrument, PlaneProbe) for own in mounted):
        raise BenchError("--instrument: a plane needs --absolute; a gauge reads deflections")
    probes = [own for own in mounted if isinstance(own.instrument, Tracker) and own.instrument.sigma_rotation]
    if not mounted or (probes and len(mounted) > 1):
        raise BenchError("instruments: expected at least one, a probe of orientations alone")
    settled = settle_both(cell.plant, truth, loaded.q, loaded.wrench, loaded.point)
    parts = [_read(cell, loaded, settled, layer, rng) for layer in _layers(cell, mounted)]
    if probes or all(part.direction is None for part in parts):
        data = join_rows(parts)
    else:
        data = join_rows([_with_lines(part) for part in parts])
    order = np.argsort(np.tile(np.arange(len(loaded.q)), len(parts)), kind="stable")
    return replace(select_rows(data, order), run=np.arange(data.runs) + 1)


def check_markers(cell: Cell, mounted: Sequence[Mounted]) -> None:
    """Refuse an instrument of a marker that the arm does not have, by BenchError.

    Args:
        cell: The arm.
        mounted: The instruments.
    """
    for own in mounted:
        if own.marker and own.marker not in cell.arm.markers:
            have = ", ".join(cell.arm.markers)
            raise BenchError(f"instrument: no marker {own.marker!r} in {cell.arm.name}; markers are {have}")


def _layers(cell: Cell, mounted: Sequence[Mounted]) -> list[list[Mounted]]:
    """Split instruments into layers in each of which every marker is read once."""
    layers: list[tuple[set[str], list[Mounted]]] = []
    for own in mounted:
        markers = {own.marker} if own.marker else set(cell.arm.markers)
        layer = next((layer for layer in layers if not layer[0] & markers), None)
        if layer is None:
            layer = (set(), [])
            layers.append(layer)
        layer[0].update(markers)
        layer[1].append(own)
    return [own for _, own in layers]


def _read(
    cell: Cell, loaded: LoadedPoses, settled: "Pair", layer: Sequence[Mounted], rng: np.random.Generator
) -> Dataset:
    """Read instruments of different markers."""
    markers, runs = cell.arm.markers, len(loaded.q)
    read, P = np.zeros((2, runs, len(markers), 3)), np.zeros((runs, len(markers), 3, 3))
    direction, tilt, reach = np.zeros(read.shape[1:]), np.zeros(P.shape[:2]), np.zeros(P.shape[:2])
    turned: dict[str, object] = {}
    for own in layer:
        if isinstance(own.instrument, Tracker):
            some = [markers.index(own.marker)] if own.marker else list(range(len(markers)))
            read[:, :, some] = [
                read_positions(own.instrument, equilibrium.markers[:, some], rng) for equilibrium in settled
            ]
            P[:, some] = np.eye(3) / (2 * own.instrument.sigma**2)
            if own.instrument.sigma_rotation:
                both = [
                    read_orientations(own.instrument, equilibrium.rotation, rng) for equilibrium in settled
                ]
                turned = dict(zip(("rotation_before", "rotation_after"), both, strict=True))
                turned["sigma_rotation"] = own.instrument.sigma_rotation
            continue
        k = markers.index(own.marker)
        u, tilt[:, k], reach[:, k] = _line(cell, loaded.q, own)
        places = tuple(equilibrium.markers[:, k] for equilibrium in settled)
        if isinstance(own.instrument, Gauge):
            rotations = tuple(equilibrium.rotation for equilibrium in settled)
            numbers = own.instrument.read(u, places, rotations, loaded.pose, rng)  # type: ignore[arg-type]
        else:
            assert isinstance(own.instrument, DistanceMeter)
            numbers = own.instrument.read(np.asarray(own.fixed), places, rng)  # type: ignore[arg-type]
        lost = np.asarray(np.isnan(numbers).any(axis=0))
        direction[:, k] = u
        read[:, :, k] = np.nan_to_num(numbers)[..., None] * u
        P[:, k] = along_lines(u, own.instrument.sigma) * ~lost[:, None, None]
    lines = bool(direction.any() or tilt.any() or reach.any())
    whole = not lines and bool(P.any(axis=(2, 3)).all())
    return Dataset(
        markers=markers,
        run=np.arange(runs) + 1,
        **vars(loaded),
        before=read[0],
        after=read[1],
        sigma=layer[0].instrument.sigma,
        precision=None if whole else P,
        direction=direction if lines else None,
        tilt=tilt if lines else None,
        reach=reach if lines else None,
        **turned,  # type: ignore[arg-type]
    )


def _line(cell: Cell, q: Array, own: Mounted) -> tuple[Array, Array, Array]:
    """Compute direction, its standard deviation and reach in every pose, as they are said to be."""
    if isinstance(own.instrument, Gauge):
        u = np.broadcast_to(np.asarray(own.direction, dtype=float), (len(q), 3))
        u = u / np.maximum(np.linalg.norm(u, axis=1, keepdims=True), np.finfo(float).tiny)
        if own.on_tool:
            u = np.matvec(tool_poses(cell.vjm, q)[1], u)
        return u, np.full(len(q), own.instrument.tilt), np.zeros(len(q))
    assert isinstance(own.instrument, DistanceMeter)
    assert own.fixed is not None
    beam = tool_points(cell.vjm, q, marker_positions(cell.vjm, (own.marker,)))[:, 0] - own.fixed
    reach = np.linalg.norm(beam, axis=1)
    return beam / reach[:, None], own.instrument.fixed_point_sigma / reach, reach


def _with_lines(data: Dataset) -> Dataset:
    """Give data of positions alone the fields of readings along lines."""
    if data.direction is not None:
        return data
    none = np.zeros(data.before.shape[:2])
    P = np.broadcast_to(np.eye(3) / (2 * data.sigma**2), (*data.before.shape, 3)).copy()
    P = P if data.precision is None else data.precision
    return replace(data, direction=np.zeros_like(data.before), tilt=none, reach=none, precision=P)
