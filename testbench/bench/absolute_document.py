"""What model.json of a calibrated arm holds: typed rows, the unit in the name."""

from typing import Annotated, Literal

from pydantic import Field

from testbench.arm.document import Strict
from testbench.bench.model_document import AboutRow, Document, Numbers, Rows

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


class CalibrationDocument(Document):
    """model.json of `testbench calibrate`."""

    format: Literal[1, 2]
    kind: Literal["absolute calibration"]
    compliances: Literal["none", "joints", "links"]
    theta_0: Numbers
    C_theta: Rows
    errors: ErrorsRow
    noise: NoiseRow
    columns: list[Few]
    frames: dict[str, FrameRow]
    mounts: dict[str, MountRow]
    about: AboutRow | None = None  #: Null in format 1.
