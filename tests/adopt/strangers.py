"""Robots as strangers describe them, small and made up here: URDF and MJCF with the habits of real files.

Light has seven turned axes, meshes of a package in millimetres and a gripper that mimics; heavy has boxes and
cylinders, and not a single mass. Classes has default classes, a <frame>, an included file and coupled
fingers; mounted has degrees, a turned mount, masses of geoms, a joint off its body and one with ref; sliding
has a slide on the floor, two hinges on one body, and a joint without a name.
"""

import shutil
from functools import partial
from pathlib import Path

ROBOTS = Path(__file__).parent / "robots"
MESH = ROBOTS / "light" / "light_support" / "meshes" / "link.stl"
"""A tetrahedron of 100 x 60 x 200 as binary STL, behind its own origin."""


def described(robot: str, file: str, folder: Path) -> Path:
    """A robot's file, copied into a folder with all that belongs to it."""
    shutil.copytree(ROBOTS / robot, folder, dirs_exist_ok=True)
    return folder / file


light_urdf = partial(described, "light", "light_support/urdf/light.urdf")
heavy_urdf = partial(described, "heavy", "heavy.urdf")
classes_mjcf = partial(described, "classes", "classes.xml")
mounted_mjcf = partial(described, "mounted", "mounted.xml")
sliding_mjcf = partial(described, "sliding", "sliding.xml")
