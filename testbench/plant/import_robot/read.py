"""A stranger's robot file, URDF or MJCF, as one serial chain."""

from pathlib import Path

from testbench.errors import InputError
from testbench.plant.import_robot.chain import Chain
from testbench.plant.import_robot.mjcf import read_mjcf_tree
from testbench.plant.import_robot.reduce import reduce_tree
from testbench.plant.import_robot.source import read_xml
from testbench.plant.import_robot.urdf import read_urdf


def read_chain(file: Path, tip: str | None = None) -> Chain:
    """The arm that a robot's file describes.

    Args:
        file: URDF, or MJCF with the files that it names.
        tip: The link, body or site that carries the tool; None for the end of the longest chain.

    Raises:
        InputError: Names the file, the place and what was expected.
    """
    root = read_xml(file)
    if root.tag == "robot":
        tree = read_urdf(file, root)
    elif root.tag == "mujoco":
        tree = read_mjcf_tree(file, root)
    else:
        raise InputError(file, "", f"expected URDF (<robot>) or MJCF (<mujoco>) at the top, got <{root.tag}>")
    return reduce_tree(file, tree, tip)
