"""What model.json says, of either kind of model: typed rows of what is read back, the unit in the name."""

from typing import Annotated, ClassVar, Literal

from pydantic import AfterValidator, ConfigDict, Field, JsonValue
from pydantic_core import PydanticCustomError

from testbench.arm.document import Strict

LARGEST = 1e12  #: Of a model's numbers, whatever the unit: squares of products of them are finite.
LONGEST, NAME = 20_000, 255
"""Longest text of a model, and longest name of its arm [characters]."""
PRINTED = (
    "^[^\\x00-\\x1f\\x7f-\\x9f\\u2028\\u2029]*$"  #: Texts without control characters, which no XML holds.
)
Number = Annotated[float, Field(ge=-LARGEST, le=LARGEST)]
MOST, MOST_TEXTS = 100_000, 1000  #: Numbers of a list, and texts.
Numbers = Annotated[list[Number], Field(max_length=MOST)]
Rows = Annotated[list[Numbers], Field(max_length=MOST)]
Texts = Annotated[list[str], Field(max_length=MOST_TEXTS)]
Size = Annotated[float, Field(ge=0, le=LARGEST)]
Few = Annotated[int, Field(ge=0, le=10_000)]
Free = dict[str, JsonValue]  #: For people: nothing is computed from it.
LEAST = 1e-30  #: Of what is divided by, besides zero, which says that there is none.


def _divides(scale: float) -> float:
    if 0 < scale < LEAST:
        raise PydanticCustomError("scale", "Input should be 0 or at least {least}", {"least": LEAST})
    return scale


class Row(Strict):
    """A part of model.json, perhaps a stranger's: no text of it fills a page."""

    model_config = ConfigDict(str_max_length=LONGEST)


class Head(Strict):
    """What tells one kind of model from another."""

    model_config = ConfigDict(strict=True, frozen=True, extra="ignore")

    kind: str
    format: int


class WeightsRow(Row):
    """Masses and centres of all bodies."""

    mass_kg: list[Size]
    centre_m: Rows


class AboutRow(Row):
    """Where a model comes from."""

    method: str
    #: SHA-256 of every file of readings, by its name.
    data: Annotated[dict[str, str], Field(max_length=MOST_TEXTS)]
    doubts: Texts
    force_N: Size | None
    moment_Nm: Size | None
    versions: dict[str, str]


class Document(Row):
    """What all kinds have."""

    KIND: ClassVar[str]  #: As model.json names it.
    FORMATS: ClassVar[range]  #: Those that are read, the last one is written.
    SEALED: ClassVar[int]  #: The first of them that has checksums.
    COMMAND: ClassVar[str]  #: That writes it.
    ARRAYS: ClassVar[tuple[str, ...]]  #: Of posterior.npz.

    kind: str
    format: int
    arm: Annotated[str, Field(max_length=NAME, pattern=PRINTED)]
    digests: dict[str, str]
    weights: WeightsRow
    about: AboutRow | None = None  #: Null before `SEALED`.
    posterior: str | None = None  #: SHA-256 of posterior.npz.
    checksum: str | None = None  #: Of all the rest, see `model_folder.sealed`.


class Entry(Row):
    """An entry of C_theta, and of its mirror where the structure is symmetric [m/N, rad/(N m), rad/N]."""

    row: str  #: Link and axis, such as link_2.phi_x, or a joint.
    column: str
    value: Number


class StructureRow(Row):
    """Which compliances were unknown, and what they are."""

    name: str
    symmetric: bool
    entries: list[Entry]


class SpreadRow(Row):
    """Of the distribution in posterior.npz."""

    #: Of Student's distribution; null for the normal one.
    degrees_of_freedom: Annotated[float, Field(gt=0, le=LARGEST)] | None
    heavy_rows: Annotated[int, Field(ge=0)]  #: Last rows of root that are the prior's, of Student's.
    pull: Size
    on_boundary: bool


class StiffnessDocument(Document):
    """model.json of `testbench identify`; docs/formats.md says what `Free` parts hold."""

    KIND, FORMATS, SEALED, COMMAND = "stiffness", range(1, 2), 1, "testbench identify"
    ARRAYS = ("pi", "root", "unseen", "scale")  # those of `Posterior`, pi its x

    format: Literal[1]
    kind: Literal["stiffness"]
    name: str  #: Of the model, such as ALL153 + prior.
    conservative: bool
    structure: StructureRow
    links: dict[str, Rows]  #: Compliance of every link in its beam frame.
    #: Of every joint; null where it is counted in that of the link before it.
    joints: dict[str, Number | None]
    units: str  #: Of both.
    prior: Free | None
    runs: Free
    certificate: Free
    unseen: Free
    spread: SpreadRow
    notes: Texts
    about: AboutRow


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

    KIND, FORMATS, SEALED, COMMAND = "absolute calibration", range(1, 3), 2, "testbench calibrate"
    #: Root of the precision, (a, a), and L of the metric of the compliances in it, (e, e).
    ARRAYS = ("root", "L")

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
