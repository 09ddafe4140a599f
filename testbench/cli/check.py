"""testbench check ARM: what is in an arm's folder, or what is wrong with it."""

import numpy as np
from rich.console import Console

from testbench.arm.folder import Arm
from testbench.bench.campaign import Cell, build_cell, stream
from testbench.cli.arguments import ArmName
from testbench.errors import BenchError
from testbench.model.vjm import chain
from testbench.plant import settle_linear

AGREEMENT, POSES = 1e-9, 20
"""Distance of the tool between the two readings of an arm [m], and poses in which it is compared."""


def command(arm: ArmName) -> None:
    """Read an arm with MuJoCo and Pinocchio, and compare."""
    cell = build_cell(arm)
    console = Console(highlight=False)
    for line in contents(cell.arm):
        console.print(line)
    distance = apart(cell)
    if distance > AGREEMENT:
        raise BenchError(f"{arm}: MuJoCo and Pinocchio place tool, load or markers {distance:.1e} m apart")
    console.print(f"MuJoCo and Pinocchio place tool, load and markers alike, within {distance:.0e} m")


def contents(arm: Arm) -> list[str]:
    """Links, joints and frames of an arm, one a line."""
    lines = [f"{arm.name}: {arm.title}"]
    for k, link in enumerate(arm.links):
        tip, turn = link.compliance[1, 1], link.compliance[5, 5]
        lines.append(f"  {link.name}: bends {tip:.3g} m/N and {turn:.3g} rad/(N m) at its end")
        for joint in arm.joints[k : k + 1]:
            low, high = np.rad2deg([joint.lower, joint.upper])
            lines.append(f"  {joint.name}: {low:.0f} to {high:.0f} deg, {joint.compliance:.3g} rad/(N m)")
    return [*lines, f"  tool {arm.tool}, load point {arm.load}, markers {', '.join(arm.markers)}"]


def apart(cell: Cell) -> float:
    """Largest distance between tool, load point and markers by MuJoCo and by Pinocchio [m]."""
    lower, upper = cell.arm.limits
    q = stream(0).uniform(lower, upper, (POSES, cell.arm.n_joints))
    idle = np.zeros((POSES, 6))
    rest, where = settle_linear(cell.plant, q, idle, idle[:, :3]), chain(cell.vjm, q)
    nominal = where.position[:, None] + cell.vjm.markers @ where.rotation.transpose(0, 2, 1)
    return max(
        float(np.abs(rest.tool - where.position).max()),
        float(np.abs(rest.markers - nominal).max()),
        float(np.abs(cell.plant.load - cell.vjm.load).max()),
    )
