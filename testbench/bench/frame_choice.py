"""The frame of a user's readings: found, said, or given as a TOML file."""

from dataclasses import replace
from pathlib import Path
from typing import Annotated, get_args

import numpy as np
from pydantic import Field, ValidationError

from testbench.arm.document import Strict, parse_toml
from testbench.bench.campaign import Cell
from testbench.data.dataset import Dataset
from testbench.errors import BenchError, InputError, read_text
from testbench.identify.registered import Choice, Registered, registered
from testbench.identify.registration import Frame

MAX_BYTES = 20_000
Metres = Annotated[float, Field(ge=-1000, le=1000)]
Degrees = Annotated[float, Field(ge=-360, le=360)]


class _Frame(Strict):
    """The base in the tracker's frame: a reading is R x + position, R = Rz Ry Rx."""

    station: int = 1  #: Identifier of the station.
    position_m: list[Metres] = Field(min_length=3, max_length=3)
    rotation_xyz_deg: list[Degrees] = Field(min_length=3, max_length=3)  #: About the tracker's x, y, then z.


class _File(Strict):
    frame: list[_Frame] = Field(min_length=1, max_length=100)


def to_base(cell: Cell, data: Dataset, frame: str = "auto") -> tuple[Cell, Registered]:
    """The cell with targets where they are, and the runs in the base's frame.

    Args:
        cell: The arm.
        data: The runs as they were read.
        frame: auto, base, tracker, or the name of a TOML file with the frames.

    Raises:
        InputError: When the file is wrong.
        BenchError: When the frame is no such word, or cannot be found.
    """
    words = get_args(Choice)
    choice: Choice | tuple[Frame, ...]
    if frame in words:
        choice = next(word for word in words if word == frame)
    elif files := frame_files(frame):
        to_world = np.asarray(np.linalg.inv(cell.vjm.base), dtype=float)
        choice = tuple(one.of(to_world) for one in read_frames(files[0]))
    else:
        raise BenchError(f"--frame: expected {', '.join(words)} or a .toml file, got {frame[:80]!r}")
    found = registered(cell.vjm, data, choice)
    return replace(cell, vjm=found.vjm), found


def frame_files(frame: str) -> list[Path]:
    """The file that a choice of frame names, if it names one."""
    return [Path(frame)] if frame.endswith(".toml") else []


def read_frames(path: Path) -> tuple[Frame, ...]:
    """Bases in the frames of stations, as a user gives them.

    Raises:
        InputError: Names the key and what was expected.
    """
    from scipy.spatial.transform import Rotation  # here: it takes long to import, and few runs need it

    content = parse_toml(path, read_text(path, MAX_BYTES))
    try:
        given = _File.model_validate(content).frame
    except ValidationError as err:
        first = err.errors()[0]
        place = ".".join(str(part) for part in first["loc"])
        hint = "expected [[frame]] with position_m and rotation_xyz_deg of the base in the tracker's frame"
        raise InputError(path, place, f"{first['msg']}; {hint}") from err
    stations = [one.station for one in given]
    if len(set(stations)) < len(stations):
        raise InputError(path, "frame", f"expected every station once, got {stations}")
    return tuple(
        Frame(
            one.station,
            Rotation.from_euler("xyz", one.rotation_xyz_deg, degrees=True).as_matrix(),
            np.array(one.position_m),
            np.zeros((6, 6)),
        )
        for one in given
    )
