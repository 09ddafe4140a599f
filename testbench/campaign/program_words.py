"""What predictions and corrections say of loads and directions, in words."""

import numpy as np

from testbench.arm.folder import Arm
from testbench.correct.beyond import Extent
from testbench.correct.compensated import Refusal
from testbench.errors import Array

OVERLOAD = 1.5  #: Times the payload beyond which a force is said.
SLACK = 1.05  #: Up to so many times the largest load nothing is said.
NEAR, MOSTLY = 10.0, 30.0  #: Angles up to which a direction is along an axis, and mostly along it [deg].


def extrapolated(found: Extent) -> tuple[str, ...]:
    """What loads are beyond those of the model's data, or the payload, with its number."""
    if found.force_ratio is not None and np.isinf(found.force_ratio):
        said = [f"extrapolated: {found.force:,.0f} N, and the model was identified under own weight alone"]
    else:
        sizes = (
            (found.force, "N", found.force_ratio, "force"),
            (found.moment, "N m", found.moment_ratio, "moment"),
        )
        said = [
            f"extrapolated: {value:,.0f} {unit} are {ratio:.1f} times the largest {what} that the model was "
            "identified under"
            for value, unit, ratio, what in sizes
            if ratio is not None and ratio > SLACK
        ]
    if found.payload_ratio is not None and found.payload_ratio > OVERLOAD:
        said.append(
            f"{found.force:,.0f} N are {found.payload_ratio:.1f} times the payload that the arm states"
        )
    return tuple(said)


def refusal_words(arm: Arm, refusal: Refusal | None) -> str | None:
    """Why a point cannot be put right; None where it is."""
    if refusal is None:
        return None
    if refusal.why == "limit":
        joint = next(joint for joint in arm.joints if joint.name in refusal.names)
        return f"{joint.name} would pass its limit by {joint.shown * refusal.size:.3g} {joint.shown_unit}"
    if refusal.why == "collision":
        return f"{refusal.names[0]} would collide with {refusal.names[1]}"
    return (
        f"out of reach, {1e3 * refusal.size:.3g} mm are left" if refusal.why == "reach" else "no equilibrium"
    )


def direction_words(direction: Array) -> str:
    """A direction in world axes, (3,), for people, such as "mostly along y" or "between x and -z"."""
    size = np.abs(direction) / np.linalg.norm(direction)
    first, second = np.argsort(-size)[:2]
    angle = float(np.degrees(np.arccos(min(size[first], 1.0))))
    if angle <= NEAR:
        return f"along {'xyz'[first]}"
    if angle <= MOSTLY:
        return f"mostly along {'xyz'[first]}"
    side = "" if direction[first] * direction[second] > 0 else "-"
    return f"between {'xyz'[first]} and {side}{'xyz'[second]}"
