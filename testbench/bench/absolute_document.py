"""What model.json of a calibrated arm holds: typed rows, the unit in the name."""

from typing import Annotated, Literal

from pydantic import Field

from testbench.arm.document import Strict

Numbers = list[float]
Rows = list[Numbers]
Few = Annotated[int, Field(ge=0, le=10_000)]


class FrameRow(Strict):
    """The base in a tracker's frame."""

    rotation: Rows
    translation_m: Numbers


class MountRow(Strict):
    """Targets on the tool, by name."""

    markers: list[str]
    points_m: Rows
    rotation: Rows


class ErrorsRow(Strict):
    """Errors of the joints, a row of coefficients a joint."""

    orders: list[Few]
    ratio: bool
    play: bool
    stiffening: bool
    coefficients: Rows
    torque_scale: Numbers


class NoiseRow(Strict):
    """How far readings scatter; factors of every kind of equations."""

    open_position_m: Annotated[float, Field(ge=0)]
    open_rotation_rad: Annotated[float, Field(ge=0)]
    factor: list[Annotated[float, Field(gt=0)]]


class WeightsRow(Strict):
    """Masses and centres of all bodies."""

    mass_kg: list[Annotated[float, Field(ge=0)]]
    centre_m: Rows


class Document(Strict):
    """model.json."""

    format: Literal[1]
    kind: Literal["absolute calibration"]
    arm: str
    digests: dict[str, str]
    compliances: Literal["none", "joints", "links"]
    theta_0: Numbers
    C_theta: Rows
    errors: ErrorsRow
    weights: WeightsRow
    noise: NoiseRow
    columns: list[Few]
    frames: dict[str, FrameRow]
    mounts: dict[str, MountRow]
