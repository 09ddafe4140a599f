"""testbench check ARM: what an arm's folder holds, what to confirm, what may be wrong with it."""

from dataclasses import dataclass
from math import ceil
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from testbench.arm.elastic import JointEntry, LinkEntry
from testbench.arm.folder import ArmJoint, find_arm
from testbench.arm.mjcf import GRAVITY
from testbench.errors import Array, shell_word
from testbench.model.vjm import tool_points, tool_poses
from testbench.plant.shapes import BodyFrames, elastic_frames, rigid_frames
from testbench.report.colours import GREY, NOMINAL
from testbench.report.markdown import Markdown, ended
from testbench.report.report import Report, RunRequest, bullets, say, write_run
from testbench.report.scene import Layer, PageContent, PoseGroup, Scene, arrow_scale, loads, on_tool
from testbench.report.schema import Table, TableColumn, columns, show
from testbench.report.table import Row
from testbench.report.terminal import plain_console, print_words, viewing_lines
from testbench.runs.whole import Kind, check_file, claim_folder
from testbench.workflows.arm_check import Checked, check, known_share
from testbench.workflows.options import ArmName, Force, ShownFolder, takes

COMMAND = "testbench check"  #: As manifest.json names it.
ELASTIC = Kind("an elastic arm", rb"<mujoco [^>]*model=\"[^\"]*_elastic\"")
MIN_SHOWN_SHARE = 0.01  #: Least contribution to the sag of what is listed [1].
BENT, AXIS = 0.12, 0.12  #: Lengths of sag and of the base's axes over the reach [1].


@dataclass(frozen=True)
class CheckOptions:
    """Hold the flags of the command."""

    arm: ArmName
    out: ShownFolder = None
    elastic: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write the arm with its springs as MJCF.")
    ] = None
    force: Force = False


@takes(CheckOptions, draws=True)
def command(asked: CheckOptions) -> None:
    """Read an arm with MuJoCo and Pinocchio, compare, list what to confirm and warnings."""
    folder, springs = find_arm(asked.arm), asked.elastic
    if springs is not None:
        check_file(springs, ELASTIC, inputs=[folder], force=asked.force)
    with claim_folder(asked.out, COMMAND, own=frozenset(), inputs=[folder], force=asked.force):
        checked = check(asked.arm)
        said, (first, *rest) = report(checked), contents(checked)
        listed, console = said.numbers["confirm"], plain_console()
        console.print(first, soft_wrap=True)
        lines = [
            "\nPlease confirm these numbers, each with its contribution to the deflection:",
            *(f"{row.hangs_percent:5.0f} %  {row.number}" for row in listed),
            f"         {len(checked.items) - len(listed)} more contribute less than 1 % each",
            f"{100 * known_share(checked):5.0f} %  in all, from published, measured or inferred numbers",
            "\nRead from the folder:",
            *rest,
            "MuJoCo and Pinocchio agree on the places of links, tool, load point and markers within "
            f"{max(1, ceil(1e9 * checked.apart))} nm",
        ]
        if springs is not None:
            from testbench.files.robot.write import write_elastic  # here: it is rarely asked for

            write_elastic(checked.cell.arm, springs)
            lines.append(
                f"springs    {springs}; open it with: python -m mujoco.viewer --mjcf={shell_word(springs)}"
            )
        if asked.out is not None:
            write_run(
                asked.out, RunRequest(COMMAND, said.scenario, {}, [folder], "arm.png"), said, seen(checked)
            )
            lines += [f"picture    {asked.out / 'arm.png'}", *viewing_lines(asked.out, arm=asked.arm)]
        print_words(console, said, [said.tables["sag"]], lines)


def report(checked: Checked) -> Report:
    """Report the deflection under the payload, what to confirm, and warnings."""
    arm, sag = checked.cell.arm, checked.sag
    names = [*(link.name for link in arm.links), *(joint.name for joint in arm.joints)]
    parts = [Row(part=n, sag_share_percent=100 * s) for n, s in zip(names, sag.shares.tolist(), strict=True)]
    listed = [item for item in checked.items if item.share >= MIN_SHOWN_SHARE]
    confirm = [Row(number=item.words, hangs_percent=100 * item.share) for item in listed]
    per = 1e3 * (arm.payload or 1.0) * np.sort(sag.size)
    low, middle, high = np.quantile(per, [0.05, 0.5, 0.95]).tolist()
    f = Row(
        arm=arm.name,
        payload_kg=arm.payload,
        what=f"{arm.payload:g} kg" if arm.payload else "1 kg",
        sag_mm=Row(low=low, median=middle, high=high, most=float(per[-1])),
        place_m=tool_poses(checked.vjm, sag.q[checked.worst][None])[0][0].tolist(),
        joints=arm.pose_text(sag.q[checked.worst]) if arm.joints else "",
        softest=max(parts, key=lambda part: part.sag_share_percent),
        doubts=[doubt.sentence for doubt in checked.doubts],
        confirm=confirm,
        parts=parts,
        contents=contents(checked),
    )
    sizes = {"low": "5th percentile", "median": "median", "high": "95th percentile", "most": "largest"}
    ends = [TableColumn(key, heading, "mm", ".3g") for key, heading in sizes.items()]
    where = (TableColumn("at", "position of the tool, m"), TableColumn("joints", "joint angles"))
    row = Row(f.sag_mm, load=f.what, at=_place(np.array(f.place_m)), joints=f.joints)
    tables = {
        "sag": Table(
            (TableColumn("load", "payload"), *ends), [row], "Deflection of the tool over random poses"
        ),
        "worst": Table(where, [row], "Pose of the largest deflection"),
        "confirm": Table(
            (TableColumn("number", "number and its origin"), *columns("hangs_percent")),
            confirm,
            "Numbers to confirm",
        ),
        "parts": Table(
            columns("part sag_share_percent"), parts, "Contribution of each link and joint to the deflection"
        ),
    }
    return Report(
        scenario=f.arm,
        question=say("Is this {arm}?", f),
        title=say("{text}", text=f.contents[0]),
        answer=say(
            "{what} move the tool by {sag_mm.median:.3g} mm (median over random poses). Warnings: {count}.",
            f,
            count=len(f.doubts),
        ),
        claims=[say("**Warning**: {text}", text=ended(text)) for text in f.doubts],
        numbers=f,
        tables=tables,
        body=[
            *tables,
            Markdown("## What was understood"),
            bullets(say("{text}", text=text.strip()) for text in f.contents),
        ],
    )


def contents(checked: Checked) -> list[str]:
    """List payload, links, joints and frames, each with its unit and origin."""
    arm = checked.cell.arm
    elastic = checked.elastic
    vjm = checked.cell.vjm
    lines = [f"{arm.name}: {arm.title}"]
    if elastic.payload is None:
        lines.append("  payload: not stated")
    else:
        lines.append(f"  payload: {elastic.payload.value:g} kg, {elastic.payload.origin}")
    lines.append(f"  base: at {_place(vjm.base_pose[:3, 3])} m; reach {vjm.reach:.3g} m")
    for k, link in enumerate(elastic.link):
        lines.append(f"  {link.name}: {_link(link)}")
        if k < arm.n_joints:
            lines.append(f"  {arm.joints[k].name}: {_joint(arm.joints[k], elastic.joint[k])}")
    if joint_map := arm.joint_map:
        lines.append(f"  joints of files: {', '.join(joint_map.file_joint_names)}")
        rows = [f"{joint.name} = {joint_map.joint_formula(k)}" for k, joint in enumerate(arm.joints)]
        lines += [
            f"    {row}"
            for row, joint in zip(rows, arm.joints, strict=True)
            if row != f"{joint.name} = {joint.name}"
        ]
    names = f"load point {arm.load_point}", *(f"marker {name}" for name in arm.markers)
    points = zip(names, (vjm.load_point, *vjm.markers), strict=True)
    lines.append(f"  {arm.tool}: {_place(vjm.tool_placement[:3, 3])} m in the frame of {arm.links[-1].name}")
    return lines + [f"  {name}: {_place(place)} m in the tool's frame" for name, place in points]


def _link(link: LinkEntry) -> str:
    axis = f"axis {_place(np.array(link.axis))}"
    if link.tube is None:
        assert link.compliance is not None
        return f"{axis}, full 6x6 compliance ({link.compliance.origin})"
    t = link.tube
    outer, inner = 1e3 * t.outer_diameter.value, 1e3 * t.inner_diameter.value
    return (
        f"{axis}; length {1e3 * t.length.value:.0f} mm ({t.length.origin}); tube diameters "
        f"{outer:.0f}/{inner:.0f} mm, E "
        f"{1e-9 * t.youngs_modulus.value:.0f} GPa ({t.outer_diameter.origin})"
    )


def _joint(joint: ArmJoint, entry: JointEntry) -> str:
    low, high = (joint.display_factor * end for end in (joint.lower, joint.upper))
    c = entry.compliance
    value = show(1e6 * c.value, ".3g")
    return f"range {low:.0f} to {high:.0f} {joint.display_unit}; compliance {value} u{c.unit} ({c.origin})"


def _place(point: Array) -> str:
    return " ".join(f"{x:.3g}" for x in np.round(point, 3) + 0.0)


def seen(checked: Checked) -> PageContent:
    """Draw the arm: its links, and where they sag."""
    cell, q = checked.cell, checked.poses
    theta = checked.bending
    straight = rigid_frames(cell.room, q)
    moved = elastic_frames(cell.plant, q, theta).positions[:, -1] - straight.positions[:, -1]
    M = arrow_scale(moved, BENT * cell.vjm.reach)
    said = f"joints at {cell.arm.pose_text(q[0])}", f"joints at {cell.arm.pose_text(q[1])}"
    payload = "1 kg" if cell.arm.payload is None else f"{cell.arm.payload:g} kg"
    bent = elastic_frames(cell.plant, q, M * theta)
    group = PoseGroup(
        name="Poses",
        names=["Zero, or the nearest pose within the limits", "Pose of median sag"],
        words=[f"{words[0].upper()}{words[1:]}." for words in said],
        rigid=straight,
        bent=bent,
        layers=[*_beams(checked), *_tool(checked, bent)],
        first=1,
    )
    title = f"Deflection under {payload}, magnified {M:g} times. Tubes have their true diameter."
    return PageContent(scene=Scene(cell, title, [group]))


def _beams(checked: Checked) -> list[Layer]:
    """Tubes as lines, their axes as arrows, joints with their names; what is doubted has a question mark."""
    arm, beams = checked.cell.arm, checked.beams
    start, along = beams[..., :3, 3], beams[..., :3, 0] * checked.sizes[:, :1]
    begin, end = checked.tube_lines
    links = [link.name + " ?" if checked.doubted(link.name) else "" for link in arm.links]
    joints = [joint.name + " ?" * checked.doubted(joint.name) for joint in arm.joints]
    return [
        Layer("tubes", NOMINAL, "lines", begin, end),
        Layer("beam axes", NOMINAL, "arrows", start, start + along, labels=links if any(links) else ()),
        Layer("joints", GREY, "dots", start[:, 1:], labels=joints),
    ]


def _tool(checked: Checked, bent: BodyFrames) -> list[Layer]:
    """Markers, the payload on the bent arm, and the axes of the base."""
    cell, reach = checked.cell, checked.vjm.reach
    hook = on_tool(cell, bent, np.tile(cell.vjm.load_point, (len(checked.poses), 1)))
    base, out = cell.vjm.base_pose[:3, 3], AXIS * reach * cell.vjm.base_pose[:3, :3].T
    force = np.tile([0, 0, -GRAVITY * (cell.arm.payload or 0.0)], (len(hook), 1))
    markers = tool_points(cell.vjm, checked.poses, cell.vjm.markers)
    return [
        Layer("markers", NOMINAL, "dots", markers, labels=cell.arm.markers),
        *loads(hook, force, reach),
        Layer("axes of the base", GREY, "arrows", np.tile(base, (1, 3, 1)), (base + out)[None], labels="xyz"),
    ]
