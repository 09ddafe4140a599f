"""Arguments that several commands take."""

import contextlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from testbench import files
from testbench.arm.decimal import is_decimal
from testbench.errors import BenchError, word
from testbench.output.place import claim_folder
from testbench.session import SESSION

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

    from testbench.campaign.runs import Readings


def mass(text: str) -> float:
    """A hung mass, or its weight [kg]; BadParameter for anything else."""
    from testbench.campaign.plan_input import read_mass  # here: few commands read a plan's files

    try:
        return read_mass(text)
    except BenchError as err:
        raise typer.BadParameter(str(err)) from err


def mass_or_none(text: str) -> float:
    """The same; 0 where nothing hangs."""
    return 0.0 if is_decimal(text) and float(text) == 0 else mass(text)


def plain(*asked: object, read: str, without: Sequence[str] = ()) -> dict[str, object]:
    """Flags as plain data but for places of results; of files their names and digests.

    Args:
        asked: The flags, dataclasses.
        read: Field that is a file or several, beside `mapping`.
        without: Other fields that are left out.
    """
    left = {"out", "report", "force", *without}
    flags = {name: value for own in asked for name, value in vars(own).items() if name not in left}
    for name in (read, "mapping"):
        given = flags[name] if isinstance(flags[name], list) else [flags[name]]
        flags[name] = {path.name: files.digest(path) for path in filter(None, given)} or None
    return flags


def absolute_alone(flags: "DataclassInstance") -> None:
    """Refuse flags of absolute readings that are not the defaults where `absolute` is not asked for.

    Raises:
        BenchError: Names the first one.
    """
    for own in fields(flags):
        if not getattr(flags, "absolute", True) and getattr(flags, own.name) != own.default:
            raise BenchError(f"--{own.name.replace('_', '-')}: expected --absolute with it")


@contextlib.contextmanager
def claimed(out: Path | None, command: str, inputs: Sequence[Path], *, force: bool) -> Iterator[None]:
    """The folder of a command that may be asked for none; see `claim_folder`."""
    with contextlib.ExitStack() as held:
        if out is not None:
            held.enter_context(claim_folder(out, command, own=frozenset(), inputs=inputs, force=force))
        yield


ArmName = Annotated[str, typer.Argument(help="Folder with rigid.xml and elastic.toml, or one of our arms.")]
RunFolder = Annotated[Path, typer.Argument(help="Folder of a run, or one recording.")]
MapFile = Annotated[
    Path | None, typer.Option("--map", help="TOML file that says how the table names our quantities.")
]
SigmaUm = Annotated[
    float | None,
    typer.Option(min=0.001, max=10_000, help="Noise of a reading along an axis, where the file lacks it."),
]
Load = Annotated[
    float | None,
    typer.Option(
        parser=mass,
        metavar="MASS",
        help="Hangs in loaded rows where the file gives none, such as 240 or 530lb.",
    ),
]
Payload = Annotated[
    float | None,
    typer.Option(
        "--load",
        parser=mass_or_none,
        metavar="MASS",
        help="Load assumed where the file gives none, such as 240 or 530lb; 0 for no load. Default: the "
        "arm's stated payload.",
    ),
]
ArmCheck = Annotated[str | None, typer.Option(help="The arm, to check that the model belongs to it.")]
ShownFolder = Annotated[Path | None, typer.Option(help="Folder for picture, recording and page.")]
Orientations = Annotated[
    bool, typer.Option("--orientations", help="Read one target, and how it is turned, to as many urad.")
]
Noise = Annotated[float, typer.Option(min=0.001, max=10_000, help="Noise of a reading along an axis.")]


@dataclass(frozen=True)
class RunFlags:
    """Measured runs of an arm, and how they are read."""

    arm: ArmName
    dataset: Annotated[
        Path, typer.Argument(help="Measured runs, CSV, any other text table, or FILE.xlsx#SHEET.")
    ]
    mapping: MapFile = None
    sigma_um: SigmaUm = None
    load: Load = None
    frame: Annotated[
        str,
        typer.Option(
            help="Of the readings: auto, base, tracker, or a TOML file with the base in the tracker's."
        ),
    ] = "auto"
    new_target: Annotated[
        list[str] | None, typer.Option(help="Target in the file that the arm's folder lacks; again for more.")
    ] = None

    @property
    def words(self) -> str:
        """How they are read, as flags of another command; without what the project file says."""
        load, frame = None if self.load is None else f"{self.load:g}", self.frame
        own = {"map": self.mapping, "sigma_um": self.sigma_um, "load": load}
        own |= {"frame": None if frame == "auto" else frame}
        flags = [(key, value) for key, value in own.items() if value is not None]
        flags += [("new_target", name) for name in self.new_target or ()]
        taken = SESSION.get().taken
        kept = [(key, value) for key, value in flags if {"new_target": "targets"}.get(key, key) not in taken]
        return "".join(f" --{key.replace('_', '-')} {word(Path(str(value)))}" for key, value in kept)

    @property
    def readings(self) -> "Readings":
        """Where they are, and how they are read."""
        from testbench.campaign.runs import Readings  # here: not every command reads runs

        return Readings(self.dataset, self.mapping, self.sigma_um, self.frame, self.new_target, self.load)
