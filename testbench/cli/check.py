"""testbench check ARM: what is in an arm's folder, or what is wrong with it."""

from rich.console import Console

from testbench.arm.folder import COMPLIANCE_UNIT, Arm
from testbench.bench.agreement import check_agreement
from testbench.bench.campaign import build_cell
from testbench.cli.arguments import ArmName


def command(arm: ArmName) -> None:
    """Read an arm with MuJoCo and Pinocchio, and compare."""
    cell = build_cell(arm)
    console = Console(highlight=False)
    for line in contents(cell.arm):
        console.print(line)
    distance = check_agreement(cell.vjm, cell.plant)
    console.print(f"MuJoCo and Pinocchio place links, tool, load and markers alike, within {distance:.0e} m")


def contents(arm: Arm) -> list[str]:
    """Links, joints and frames of an arm, one a line."""
    lines = [f"{arm.name}: {arm.title}"]
    for k, link in enumerate(arm.links):
        tip, turn = link.compliance[1, 1], link.compliance[5, 5]
        lines.append(f"  {link.name}: bends {tip:.3g} m/N and {turn:.3g} rad/(N m) at its end")
        for joint in arm.joints[k : k + 1]:
            low, high = (joint.shown * end for end in (joint.lower, joint.upper))
            limits, unit = f"{low:.0f} to {high:.0f} {joint.shown_unit}", COMPLIANCE_UNIT[joint.prismatic]
            lines.append(f"  {joint.name}: {limits}, {joint.compliance:.3g} {unit}")
    return [*lines, f"  tool {arm.tool}, load point {arm.load}, markers {', '.join(arm.markers)}"]
