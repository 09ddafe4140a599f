"""What model.json of a calibrated arm holds: typed rows, the unit in the name."""

from typing import Annotated, Literal

from pydantic import AfterValidator, Field
from pydantic_core import PydanticCustomError

from testbench.bench.model_document import LARGEST, AboutRow, Document, Numbers, Row, Rows, Size

Few = Annotated[int, Field(ge=0, le=10_000)]
LEAST = 1e-30  #: Of what is divided by, besides zero, which says that there is none.


def _divides(scale: float) -> float:
    if 0 < scale < LEAST:
        raise PydanticCustomError("scale", "Input should be 0 or at least {least}", {"least": LEAST})
    return scale


class FrameRow(Row):
    """The base in a tracker's frame."""

    rotation: Rows
    translation_m: Numbers


class MountRow(Row):
    """Targets on the tool, by name."""

    markers: list[str]
    points_m: Rows
    rotation: Rows


class ErrorsRow(Row):
    """Errors of the joints, a row of coefficients a joint."""

    orders: list[Few]
    ratio: bool
    play: bool
    stiffening: bool
    coefficients: Rows
    torque_scale: list[Annotated[Size, AfterValidator(_divides)]]


class NoiseRow(Row):
    """How far readings scatter; factors of every kind of equations."""

    open_position_m: Size
    open_rotation_rad: Size
    factor: list[Annotated[float, Field(gt=0, le=LARGEST)]]


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
