"""Contacts of a rigid arm in MuJoCo, its floor, and names of the parts in contact."""

import xml.etree.ElementTree as ET
from pathlib import Path

import mujoco

from testbench.errors import InputError

COLLIDES = {"contype": str(2**31 - 1), "conaffinity": str(2**31 - 1), "gap": "0", "group": "0"}
"""Attributes of a geom that collides with every colliding geom, whatever the defaults of a user's MJCF."""
MAX_CONTACTS = 5000
"""Most contacts in one pose."""
VISUAL_GROUPS = 3
"""Geoms of groups 0 to 2 are visible in MuJoCo's viewer; by convention 3 and above only collide."""


def lay_floor(root: ET.Element, height: float | None) -> None:
    """Add a floor to an MJCF document; it collides with everything that collides.

    Args:
        root: Root of the MJCF; changed in place.
        height: Height of the floor [m]; None for no floor.
    """
    if height is None:
        return
    world = root.find("worldbody")
    assert world is not None  # the arm has bodies
    place = {"type": "plane", "size": "0 0 1", "pos": f"0 0 {height!r}", "quat": "1 0 0 0"}
    ET.SubElement(world, "geom", {**place, "margin": "0", **COLLIDES})


def body_name(model: mujoco.MjModel, body: int) -> str:
    """Return the name of a body.

    Args:
        model: The MuJoCo model.
        body: Its number.

    Returns:
        Its name; body_K where the MJCF gives none.
    """
    return model.body(int(body)).name or f"body_{body}"


def collide(path: Path, model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Compute MuJoCo's contacts in a pose.

    Args:
        path: File of the model, for the message.
        model: The MuJoCo model.
        data: The pose; it receives the contacts.

    Raises:
        InputError: When there are more contacts than any arm has.
    """
    try:
        mujoco.mj_collision(model, data)
        count = int(data.ncon)
    except mujoco.FatalError:  # they are beyond MuJoCo's own memory
        count = MAX_CONTACTS + 1
    if count > MAX_CONTACTS:
        problem = f"expected at most {MAX_CONTACTS} contacts in a pose, got more: use simpler geoms"
        raise InputError(path, "<geom>", problem)
