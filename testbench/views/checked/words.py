"""What was understood of an arm, what must be confirmed, what may be wrong, a line each."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from testbench.arm.elastic import JointEntry, LinkEntry
from testbench.arm.folder import Joint
from testbench.bench.checked import Checked
from testbench.bench.confirm import Item
from testbench.errors import Array
from testbench.views.markdown import Words
from testbench.views.schema import Column, Table, show

MOST = 12  #: Numbers to confirm that are listed.
SHOWN = 0.01  #: Least share of the sag of what is listed [1].


@dataclass(frozen=True)
class Part:
    """What a link or joint does of the sag."""

    name: str
    share: float  #: [1].


def words(checked: Checked) -> Words:
    """The words of page and recording."""
    values = {
        "checked": checked,
        "sag": sag_words(checked),
        "most_mm": 1e3 * (checked.cell.arm.payload or 1.0) * float(checked.sag.size[checked.worst]),
        "softest": max(_parts(checked), key=lambda part: part.share),
        "items": listed(checked, MOST),
        "contents": contents(checked),
    }
    return Words(Path(__file__).parent, values, "checked.md.j2")


def tables(checked: Checked) -> list[Table]:
    """What must be confirmed, and what each link and joint does of the sag."""
    share = Column("share", "share of the sag that hangs on it", "%", ".0f", scale=100)
    of_part = Column("share", "its share of the sag", "%", ".1f", scale=100)
    return [
        Table((Column("words", "number"), share), listed(checked, len(checked.items)), "To confirm"),
        Table((Column("name", "link or joint"), of_part), _parts(checked), "What sags"),
    ]


def _parts(checked: Checked) -> list[Part]:
    """What each link and joint does of the sag."""
    arm, shares = checked.cell.arm, checked.sag.shares.tolist()
    names = [*(link.name for link in arm.links), *(joint.name for joint in arm.joints)]
    return [Part(name, share) for name, share in zip(names, shares, strict=True)]


def contents(checked: Checked) -> list[str]:
    """Payload, links, joints and frames, each with its unit and origin."""
    arm, elastic, vjm = checked.cell.arm, checked.elastic, checked.cell.vjm
    lines = [f"{arm.name}: {arm.title}"]
    if elastic.payload is None:
        lines.append("  payload: not stated")
    else:
        lines.append(f"  payload: {elastic.payload.value:g} kg, {elastic.payload.origin}")
    lines.append(f"  base: at {_place(vjm.base[:3, 3])} m; reach {checked.reach:.3g} m")
    for k, link in enumerate(elastic.link):
        lines.append(f"  {link.name}: {_link(link)}")
        if k < arm.n_joints:
            lines.append(f"  {arm.joints[k].name}: {_joint(arm.joints[k], elastic.joint[k])}")
    points = zip((arm.load, *arm.markers), (vjm.load, *vjm.markers), strict=True)
    lines.append(f"  tool {arm.tool}: {_place(vjm.tool[:3, 3])} m from {arm.links[-1].name}; in its axes:")
    lines.append(f"  load point {arm.load}, markers {', '.join(arm.markers)}")
    return lines + [f"    {name}: {_place(place)} m" for name, place in points]


def sag_words(checked: Checked) -> str:
    """How far the payload moves the tool."""
    payload, sizes = checked.cell.arm.payload, 1e3 * np.sort(checked.sag.size)
    per = payload or 1.0
    what = f"{payload:g} kg move" if payload else "each kg moves"
    low, middle, high = per * np.quantile(sizes, [0.05, 0.5, 0.95])
    low, middle, high = (show(float(x), ".3g") for x in (low, middle, high))
    return f"{what} the tool by {middle} mm ({low} to {high} in nine of ten poses)"


def confirm_lines(checked: Checked, most: int) -> list[str]:
    """What must be confirmed, the largest effect first."""
    items = listed(checked, most)
    lines = [f"{100 * item.share:5.0f} %  {item.words}" for item in items]
    rest = len(checked.items) - len(items)
    return [*lines, f"         and {rest} more of less effect"] if rest else lines


def listed(checked: Checked, most: int) -> list[Item]:
    """What has an effect, the largest first."""
    return [item for item in checked.items if item.share >= SHOWN][:most]


def _link(link: LinkEntry) -> str:
    axis = f"along {_place(np.array(link.axis))}"
    if link.tube is None:
        assert link.compliance is not None
        return f"{axis}, a compliance in full, {link.compliance.origin}"
    t = link.tube
    outer, inner = 1e3 * t.outer_diameter.value, 1e3 * t.inner_diameter.value
    return (
        f"{axis}, {1e3 * t.length.value:.0f} mm, {t.length.origin}; tube {outer:.0f}/{inner:.0f} mm, "
        f"{1e-9 * t.youngs_modulus.value:.0f} GPa, {t.outer_diameter.origin}"
    )


def _joint(joint: Joint, entry: JointEntry) -> str:
    low, high = (joint.shown * end for end in (joint.lower, joint.upper))
    c = entry.compliance
    value = show(1e6 * c.value, ".3g")
    return f"{low:.0f} to {high:.0f} {joint.shown_unit}, {value} u{c.unit}, {c.origin}"


def _place(point: Array) -> str:
    return " ".join(f"{x:.3g}" for x in np.round(point, 3) + 0.0)
