"""MuJoCo's contacts of a rigid arm, its floor, and names for what touches."""

import xml.etree.ElementTree as ET
from pathlib import Path

import mujoco

from testbench.errors import InputError

COLLIDES = {"contype": str(2**31 - 1), "conaffinity": str(2**31 - 1), "gap": "0", "group": "0"}
"""Of a geom that collides with all that collides, whatever the defaults of a stranger's MJCF say."""
MOST_CONTACTS = 5000  #: In one pose.
VISUAL_GROUPS = 3
"""Geoms of groups 0 to 2 are visible in MuJoCo's viewer; by convention 3 and above only collide."""


def lay_floor(root: ET.Element, height: float | None) -> None:
    """Add a floor to the MJCF that collides with all that collides; None for none."""
    if height is None:
        return
    world = root.find("worldbody")
    assert world is not None  # the arm has bodies
    place = {"type": "plane", "size": "0 0 1", "pos": f"0 0 {height!r}", "quat": "1 0 0 0"}
    ET.SubElement(world, "geom", {**place, "margin": "0", **COLLIDES})


def body_name(model: mujoco.MjModel, body: int) -> str:
    """Name of a body; body_K where the MJCF gives none."""
    return model.body(int(body)).name or f"body_{body}"


def collide(path: Path, model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """MuJoCo's contacts in a pose.

    Raises:
        InputError: When there are more of them than any arm has.
    """
    try:
        mujoco.mj_collision(model, data)
        count = int(data.ncon)
    except mujoco.FatalError:  # they are beyond MuJoCo's own memory
        count = MOST_CONTACTS + 1
    if count > MOST_CONTACTS:
        problem = f"expected at most {MOST_CONTACTS} contacts in a pose, got more: use simpler geoms"
        raise InputError(path, "<geom>", problem)
