"""The frame of a user's readings: found, said, or given as a TOML file."""

import math
from dataclasses import replace
from pathlib import Path
from typing import Annotated, get_args

import numpy as np
from pydantic import Field, ValidationError

from testbench.arm.document import Strict, parse_toml
from testbench.campaign.campaign import Cell
from testbench.campaign.rows import MM
from testbench.data.dataset import Dataset
from testbench.errors import BenchError, InputError, read_text
from testbench.identify.registered import Choice, Registered, registered
from testbench.identify.registration import Frame, spread

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


def registration_row(registered: Registered) -> dict[str, object] | None:
    """Frames and targets, and how well the unloaded readings fit them; None where no frame fitted.

    Of a frame the base's position in it, turn as a rotation vector, and largest standard deviations, 0 for
    one that was given; of a target its place in the tool's frame, its distance from where the arm's folder
    has it, None if it has not, and its largest standard deviation.
    """
    found = registered.registration
    if found is None:
        return None
    away = MM * np.linalg.norm(found.targets - found.nominal, axis=1)
    frames = [one.of(registered.vjm.base) for one in found.frames]
    return {
        "frame": registered.frame,
        "frames": [
            {
                "station": one.station,
                "position_mm": (MM * one.translation).tolist(),
                "rotation_deg": np.degrees(one.rotation_vector).tolist(),
                "position_sd_mm": MM * spread(one.covariance[3:, 3:]),
                "rotation_sd_deg": math.degrees(one.deviation),
            }
            for one in frames
        ],
        "targets": [
            {
                "marker": name,
                "position_mm": (MM * found.targets[k]).tolist(),
                "from_nominal_mm": float(away[k]) if np.isfinite(away[k]) else None,
                "position_sd_mm": MM * float(found.target_deviations[k].max()),
            }
            for k, name in enumerate(found.markers)
        ],
        "rms_mm": MM * found.rms,
        "noise_mm": MM * found.noise,
        "readings": found.readings,
        "wild": found.wild,
    }
