"""Arguments that several commands take."""

from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from testbench.errors import BenchError
from testbench.runs import manifest as files

if TYPE_CHECKING:
    from _typeshed import DataclassInstance


def plain(*asked: object, read: str, without: Sequence[str] = ()) -> dict[str, object]:
    """Collect flags as plain data but for places of results; of files their names and digests.

    Args:
        read: Field that is a file or several, beside `mapping`.
        without: Other fields that are left out.
        asked: The flags, dataclasses.

    Returns:
        The flags by name.
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


RunFolder = Annotated[Path, typer.Argument(help="Folder of a run, or one recording.")]
ArmCheck = Annotated[str | None, typer.Option(metavar="ARM", help="Reject a model of any other arm.")]
ShownFolder = Annotated[
    Path | None, typer.Option(metavar="DIR", help="Folder for picture, recording and page.")
]
Orientations = Annotated[
    bool, typer.Option("--orientations", help="Read one target's position and orientation.")
]
Noise = Annotated[float, typer.Option(min=0.001, max=10_000, help="Noise of a reading along an axis.")]
