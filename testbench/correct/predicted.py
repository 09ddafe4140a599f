"""Prediction: where the tool goes under its loads, with 95 % intervals.

`predict` evaluates an identified model, by the equilibrium behind Eq. (7) or by the linear model of Eq. (6).

Extrapolation: how far loads exceed those under which a model was identified.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from testbench.arm.mjcf import GRAVITY
from testbench.correct.newton import batches, equilibrium
from testbench.correct.uncertainty import LoadedPoses, curvature, half_widths
from testbench.data.dataset import join_rows
from testbench.display import Displayed, span
from testbench.errors import Array, check_array, check_items, check_type
from testbench.identify.arm_model import ArmModel
from testbench.identify.posterior import CURVATURE_COUNT
from testbench.model.load import Load, on_joints, resultant
from testbench.model.loaded import displacement
from testbench.model.tool_motion import rotation_matrices, turn_between
from testbench.model.vjm import chain, tool_pose


@dataclass(frozen=True, repr=False)
class Prediction(Displayed):
    """Hold deflections and positions of points of the tool, its origin first, with intervals.

    Own weight acts both with and without loads.
    """

    deflection: Array  #: Loaded minus unloaded position, world axes, (poses, 1 + m, 3) [m].
    #: Half widths of its 95 % intervals, (poses, 1 + m, 3) [m]; infinite where unobservable.
    half_width: Array
    rotation_vector: Array  #: Rotation vector from unloaded to loaded tool, world axes, (poses, 3) [rad].
    position: Array  #: Loaded position, world, (poses, 1 + m, 3) [m]; on nominal geometry if not absolute.
    #: Half widths of its 95 % intervals, (poses, 1 + m, 3) [m]; infinite for a model of deflections alone.
    position_half_width: Array
    rotation: Array  #: Orientation of the loaded tool, world from tool, (poses, 3, 3) [1].
    #: Distance between the loaded tool's origin by Eq. (6) and by Eq. (7), (poses,) [m].
    linearisation_error: Array
    theta: Array  #: Virtual joints of the loaded arm at its equilibrium, (poses, n_theta) [m, rad].

    def about(self) -> dict[str, object]:
        """Summarise the prediction: numbers of poses and points, deflections of the tool's origin."""
        return {
            "poses": len(self.deflection),
            "points": self.deflection.shape[1],
            "deflection_mm": span(1e3 * self.size[:, 0]),
            "half_width_mm": span(1e3 * self.widest[:, 0]),
        }

    @cached_property
    def size(self) -> Array:
        """Compute the lengths of the deflections, (poses, 1 + m) [m]."""
        return np.asarray(np.linalg.norm(self.deflection, axis=2))

    @cached_property
    def widest(self) -> Array:
        """Return the largest half width over the three axes of every point, (poses, 1 + m) [m]."""
        return np.asarray(self.half_width.max(axis=2))


def predict(
    model: ArmModel,
    q: Array,
    loads: Sequence[Load] = (),
    *,
    points: Array | None = None,
    linear: bool = False,
) -> Prediction:
    """Predict where loads bring the tool: by the equilibrium behind Eq. (7), or by Eq. (6).

    Args:
        model: Identified model, of deflections alone or absolute, such as `load_model` reads.
        q: Joints as commanded, (poses, n) [rad, m].
        loads: Loads besides own weight, each the same in all poses or with one row per pose.
        points: Points in the tool's frame, (m, 3) [m]; None for the arm's markers.
        linear: Whether to use Eq. (6), the compliance of the unloaded arm.

    Returns:
        Deflections of the tool's origin and the points, their 95 % intervals, and where the tool is.

    Raises:
        NoEquilibrium: When the arm cannot carry the loads; the message names the pose.
        BenchError: When an argument has another type or shape, or is not finite.
    """
    check_type(model, ArmModel, "model")
    check_items(loads, Load, "loads")
    q = check_array(q, (None, model.arm.n_joints), "q [rad, m]")
    points = model.vjm.markers if points is None else check_array(points, (None, 3), "points [m]")
    points = np.vstack([np.zeros(3), points])
    every = LoadedPoses(q, loads)
    return join_rows([_predict(model, every.of(some), points, linear) for some in batches(len(q))])


def _predict(model: ArmModel, loaded: LoadedPoses, points: Array, linear: bool) -> Prediction:
    """Predict a few poses, as `predict`."""
    before, after = equilibrium(model.state, loaded.q), loaded.at_rest(model.state)
    loaded, free = replace(loaded, equilibrium=after), LoadedPoses(loaded.q, equilibrium=before)
    half = half_widths(model, loaded, free, points)
    turn, straight = turn_between(before.rotation, after.rotation), _linear(model, loaded, points)
    deflection = after.points(points) - before.points(points)
    apart = np.linalg.norm(deflection[:, 0] - straight[0][:, 0], axis=1)
    start = before.points(points)
    rotation = after.rotation
    if linear:
        # Eq. (6) is off by its curvature: once for an absolute model, CURVATURE_COUNT times for one of
        # deflections, whose half width has it once already
        curved = curvature(model, loaded, free, points)
        half = np.hypot(half, curved * (1.0 if model.absolute else np.sqrt(CURVATURE_COUNT**2 - 1)))
        deflection, turn = straight
        rotation = rotation_matrices(turn) @ before.rotation
    known = half_widths(model, loaded, None, points) if model.absolute else np.full(half.shape, np.inf)
    return Prediction(deflection, half, turn, start + deflection, known, rotation, apart, after.theta)


def _linear(model: ArmModel, stand: LoadedPoses, points: Array) -> tuple[Array, Array]:
    """Compute deflections and rotations to first order, Eq. (6), of the arm that no load has deflected."""
    state = model.state
    where = chain(model.vjm, stand.q, np.tile(state.theta_0, (len(stand.q), 1)))
    theta = (state.C_theta @ on_joints(where, stand.loads)).T
    return displacement(where, theta, points), np.einsum("xtr,rt->rx", where.J_theta[3:], theta)


@dataclass(frozen=True)
class Extent:
    """Hold the largest loads of some poses, and their ratios to those of the model's data."""

    force: float  #: Largest force in a pose, all loads together [N].
    moment: float  #: Largest moment about the tool's origin [N m].
    force_ratio: float | None  #: Largest force over that of the model's data [1]; None if unknown.
    moment_ratio: float | None  #: Largest moment over that of the model's data [1]; None if unknown.
    payload_ratio: float | None  #: Largest force over the weight of the rated payload [1]; None if unknown.


def extent(model: ArmModel, q: Array, loads: Sequence[Load]) -> Extent:
    """Compute the largest force and moment over some poses, and their ratios to those of the model's data.

    Mathematics: `cor-7`.

    Args:
        model: The model, with the largest loads of its data where these are known.
        q: Actuated joints, (poses, n) [rad, m].
        loads: Loads that act together, each the same in all poses or with one row per pose.

    Returns:
        Sizes and ratios; a ratio is None where the data's load is unknown or there is no load.

    Raises:
        BenchError: When q has another shape or is not finite, or a load has rows for another number of poses.
    """
    total = resultant(tool_pose(model.vjm, q)[1], loads)
    largest = [float(np.linalg.norm(x, axis=1).max(initial=0)) for x in np.hsplit(total, 2)]
    known = (model.about.force, model.about.moment)
    ratios = [_over(value, most) for value, most in zip(largest, known, strict=True)]
    payload = model.arm.payload
    of_payload = largest[0] / (GRAVITY * payload) if payload else None
    return Extent(largest[0], largest[1], ratios[0], ratios[1], of_payload)


def _over(value: float, known: float | None) -> float | None:
    """Divide by what is known; infinite where that is zero, None where nothing is known or to be divided."""
    if known is None or not value:
        return None
    return value / known if known else math.inf
