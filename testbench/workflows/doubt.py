"""Doubts in sentences: what `identify.diagnosis` found, by how much, what to check."""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

import numpy as np
from scipy.special import gammainc

from testbench.arm.folder import Arm
from testbench.errors import Array, Doubt
from testbench.files.scatter import SIGMA
from testbench.identify import Estimate
from testbench.identify.diagnosis.finding import Finding
from testbench.identify.hierarchy import KIND
from testbench.identify.metric import Scale

LONG = 1.0  #: Length from which metres are said instead of millimetres [m].
TURN = 1e-4  #: Turns below are not worth a word [rad].
MM = 1e3
UNITS = {
    1e-3: "1000 times too large: millimetres read as metres?",
    1e-2: "100 times too large: centimetres read as metres?",
    0.1: "10 times too large: millimetres read as centimetres?",
    0.0254: "39.4 times too large: inches read as metres?",
    1 / 25.4: "25.4 times too large: millimetres read as inches?",
    10.0: "10 times too small: centimetres read as millimetres?",
    25.4: "25.4 times too small: inches read as millimetres?",
    1e3: "1000 times too small: metres read as millimetres?",
}
"""What readings have to be multiplied with, and what that means."""
ALONG, STEEP = np.cos(np.deg2rad(3)), 120.0
"""Cosine from which gravity is along an axis of the base; tilt from which weights pull upwards [deg]."""
QUIET, CHANCE = 0.6, 1e-6
"""Share of the floor below which F_M is a doubt, and chance of it in sound readings from which it is none."""
HALF = 0.5  #: Share of the readings below the median.
WHICH = {"unloaded": "unloaded readings", "loaded": "loaded readings", "all": "readings"}


def said(found: Finding, arm: Arm, columns: Sequence[tuple[str, str]] = ()) -> Doubt:
    """What was found about readings of an arm, in a sentence.

    Args:
        found: What was found.
        arm: The arm.
        columns: Name and unit of the column in the file that every joint was read from; none if not known.
    """
    words = WORDS[found.kind](found, arm)
    if "was" in found.beside:
        ends = length(found.beside["was"]), length(found.beside["now"])
        far = f"they lie {ends[0]} from the arm's kinematics, median; with that {ends[1]}"
        if (share := found.beside.get("share", HALF)) > HALF:
            most = f"{100 * share:.0f} % of them"
            far = f"{most} lie within {ends[0]} of the arm's kinematics; with that {ends[1]}"
        words = f"the {WHICH[found.where[0]]} {words} ({far})"
    if found.kind == "joint_order" and len(columns) == len(arm.joints):
        words += f"; in a map's [columns]: {', '.join(_mended(found.where[1:], arm, columns))}"
    return Doubt(found.kind, words, found.nats)


def of_scale(scale: Scale) -> Doubt:
    """A scale of a learnt prior that the readings contradict."""
    low, high = (scale.factor * math.exp(sign * 2 * scale.deviation) for sign in (-1, 1))
    beside = "the links" if scale.name == KIND else "the others of its kind"
    factor = f"{scale.factor:.2g} times ({low:.2g} to {high:.2g})"
    words = f"the readings want {factor} the prior's compliance, beside {beside}: check the folder"
    return Doubt("prior", f"{scale.name}: {words}")


def length(metres: float) -> str:
    """A length for people: 3.42 mm, 3,420 m."""
    return f"{MM * metres:.3g} mm" if metres < LONG else f"{metres:,.4g} m"


def _three(vector: Array, factor: float, digits: int) -> str:
    return ", ".join(f"{round(factor * float(x), digits) + 0.0:.{digits}f}" for x in vector[:3])


def _frame(found: Finding, _: Arm) -> str:
    turn, at = found.size[:3], _three(found.size[3:], MM, 0)
    angle = float(np.linalg.norm(turn))
    words = f"are in a frame turned by {np.rad2deg(angle):.3g} deg about "
    words += f"({_three(turn / max(angle, 1e-12), 1, 2)}) and moved by ({at}) mm against the arm's base"
    if found.where:
        return words
    how = "too near for a tracker; they are taken as they fit the arm: --frame says what they are in"
    return f"the readings {words}, {how}"


def _targets(found: Finding, _: Arm) -> str:
    what, name = found.where
    off = f"{MM * np.linalg.norm(found.size):.0f} mm from where the arm's folder has it on the tool"
    return f"{name} is {off}" if what == "targets" else f"have {name} {off}"


def _markers(found: Finding, _: Arm) -> str:
    what, *names = found.where
    if what == "targets":
        return f"targets {', '.join(names)} are where others of them are to be: names exchanged?"
    return f"of {', '.join(names)} have each other's names"


def _angle(arm: Arm, name: str, size: float) -> str:
    joint = next(joint for joint in arm.joints if joint.name == name)
    return f"{joint.shown * size:.3g} {joint.shown_unit}"


def _joint_zero(found: Finding, arm: Arm) -> str:
    name = found.where[-1]
    ends = {arm.joints[-1].name: ", or the tool is", arm.joints[0].name: ", or the frame is turned about it"}
    return f"fit if the zero of {name} is off by {_angle(arm, name, found.size[0])}{ends.get(name, '')}"


def _notation(found: Finding, _: Arm) -> str:
    if len(found.where) == 1:
        return "fit if orientations are of the tracker in the target's frame"
    ways = zip(found.where[1::2], found.where[2::2], strict=True)
    return "fit if orientations are " + ", or ".join(f"{a} where they were read as {b}" for a, b in ways)


def _joint_order(found: Finding, arm: Arm) -> str:
    order = list(found.where[1:])
    names = [joint.name for joint in arm.joints]
    moved = [name for name, own in zip(order, names, strict=True) if name != own]
    if len(moved) == 2:
        return f"fit if {moved[1]} and {moved[0]} are exchanged"
    if order == names[::-1]:
        return "fit if the joints come in the opposite order"
    return f"fit if the joint order in the file is {', '.join(order)}"


def _mended(order: Sequence[str], arm: Arm, columns: Sequence[tuple[str, str]]) -> Iterator[str]:
    """The lines of a map that take each joint from the column that holds it."""
    for joint, (name, unit), own in zip(order, columns, arm.joints, strict=True):
        if joint != own.name:
            yield f'{joint}_{unit} = "{name}"'


def _joint_coupling(found: Finding, _: Arm) -> str:
    triples = zip(found.where[1::3], found.where[2::3], found.where[3::3], strict=True)
    sums = " and ".join(f"{joint} is the file's {joint} {sign} {other}" for joint, sign, other in triples)
    return f"fit if {sums}: does the robot count {found.where[1]} together with {found.where[3]}?"


def _order(found: Finding, _: Arm) -> str:
    what, *first = found.where
    since = f" from {'row' if what == 'all' else 'run'} {first[0]} on" if first else ""
    return f"are those of the pose {'before' if found.size[0] > 0 else 'after'}{since}"


def _pose(found: Finding, arm: Arm) -> str:
    run, *why = found.where
    words = "is its pose right?"
    if why and why[0] == "markers":
        words = f"they fit if {', '.join(why[1:])} have each other's names"
    elif why:
        words = f"they fit if {why[1]} stood {_angle(arm, why[1], found.size[0])} farther"
    return f"run {run}: its unloaded readings lie {length(found.beside['off'])} off: {words}"


def _reading(found: Finding, _: Arm) -> str:
    run, target = (*found.where, "the tool's turn")[:2]
    if "off" in found.beside:
        return f"run {run}: {target} was read {length(found.beside['off'])} off, the others were not"
    off = f"{_distance(found):.2g} mm from where the others say"
    return f"run {run}: {target} is {off}: touched, or read wrongly?"


def _run(found: Finding, _: Arm) -> str:
    return (
        f"run {found.where[0]}: its targets moved otherwise than the load says, by {_distance(found):.2g} mm"
    )


def _distance(found: Finding) -> float:
    """Root mean square distance of all targets [mm]."""
    return MM * float(np.linalg.norm(found.size)) / math.sqrt(len(found.size) / 3)


def _equal(found: Finding, _: Arm) -> str:
    where = f"run {', '.join(found.where[:5])}{' ...' * (len(found.where) > 5)}"
    if not found.where:
        where = "{count} of {of} readings".format(**found.beside)
    return f"after equals before in {where}: was one of them copied?"


def _sign(found: Finding, _: Arm) -> str:
    upwards = found.beside["upwards"]
    hint = "the force points up: its sign?" if upwards else "before and after exchanged, or the force's sign?"
    runs = "{count} of {of}".format(**found.beside)
    return f"in {runs} runs the targets move against the force: {hint}"


def _load_point(found: Finding, _: Arm) -> str:
    if "reach" in found.beside:
        words = "the load acts {away:.3g} m from the tool, the arm reaches {reach:.3g} m: millimetres?"
        return words.format(**found.beside)
    return f"the load acts ({_three(found.size, MM, 0)}) mm from the stated point, in the tool's axes"


def _moved(found: Finding, _: Arm) -> str:
    """A tracker that moved between the readings of every run, or what moved between two rows."""
    if not found.beside:
        b = found.size
        station = f" of station {found.where[0]}" if found.where else ""
        which = f"the loaded readings{station}" if station else "all loaded readings"
        turn = f"({_three(b[3:], MM, 2)}) mrad"
        return f"{which} are moved by ({_three(b, MM, 2)}) mm and turned by {turn}: did the tracker move?"
    size, what = found.beside, found.kind.removesuffix("_moved")
    other = {"target": "tracker", "tracker": "target"}[what]
    both = f"the {what} or the {other}" if size["alike"] else f"the {what}"
    angle = float(np.linalg.norm(found.size[3:]))
    turn = f" and turned by {MM * angle:.2g} mrad" if angle > TURN else ""
    words = f"{both} moved by {MM * size['shift']:.2g} mm{turn} between"
    if not size.get("pairs"):
        new = "mounts" if what == "target" else "frames"
        ends = f"rows {size['before']} and {size['after']}"
        return f"{found.where[0]}: {words} {ends}: taken as two {new}"
    ends = " and ".join(
        f"the {'loaded' if row % 2 else 'unloaded'} reading of run {row // 2}"
        for row in (size["before"], size["after"])
    )
    hint = "was it touched?" if what == "target" else "runs behind it need a station of their own"
    across = ", runs across it are wrong by as much" if size["across"] else ""
    station = f"{found.where[0]}: " if found.where[0] else ""
    return f"{station}{words} {ends}: {hint}{across}"


def _mounting(found: Finding, _: Arm) -> str:
    down, turn = found.size[:3], found.size[3:]
    tilt = float(np.rad2deg(np.arccos(np.clip(-down[2], -1.0, 1.0))))
    axis = int(np.abs(down).argmax())
    along = f"gravity along {'-+'[bool(down[axis] > 0)]}{'xyz'[axis]} of its base"
    how = {0: "the arm stands on a wall", 1: "the arm stands on a wall", 2: "the arm hangs"}[axis]
    if abs(down[axis]) < ALONG:
        how = f"the base is tilted by {tilt:.0f} deg"
        along = f"gravity along ({_three(down, 1, 2)}) of its axes"
    known = "as it stands against a level tracker" if found.beside["level"] else ""
    known = known or "so its own weight bends it, unloaded" * (tilt > STEEP)
    quat = " ".join(f"{round(float(x), 4) + 0.0:g}" for x in turn)
    state = f'state it as quat="{quat}" of the body {found.where[0]} in rigid.xml'
    return f"the readings fit if {how}: {along}{f' ({known})' * bool(known)}; {state}"


def _level(found: Finding, _: Arm) -> str:
    times = f"{1 + found.size[0]:.2f} times that"
    return f"the load of {found.beside['force']:.4g} N acts as {times}, beside the others: its mass?"


def _run_load(found: Finding, _: Arm) -> str:
    b = found.size[0]
    hint = "its mass" if b > -1 else "before and after exchanged"
    return f"run {found.where[0]}: its load acts as {1 + b:.2f} times what is stated: {hint}?"


def _force_axes(found: Finding, _: Arm) -> str:
    if found.where == ("tool",):
        return "the readings fit if forces are in the tool's axes"
    order, sign = found.where
    minus = "" if sign == "+" else ", with the other sign"
    return f"the readings fit if the forces' axes x, y, z are {', '.join(order)}{minus}"


def _scale(found: Finding, arm: Arm) -> str:
    """A factor between prior and readings; deflections that are no arm's, where a wild one is named."""
    factor = found.beside["factor"]
    if found.where:
        largest, median = MM * found.beside["largest"], MM * found.beside["median"]
        return (
            f"as a whole the deflections are {factor:.3g} times what the arm's folder predicts; the largest "
            f"is {largest:.3g} mm, {found.where[0]} in run {found.where[1]}, the median {median:.3g} mm: "
            "is that reading wrong, or are loaded readings of other runs?"
        )
    hint = "forces in another unit, a lighter load, or a folder too soft?"
    if factor > 1:
        hint = "forces in kg instead of N (9.81 times), in kN, a heavier load, or a folder too stiff?"
    times = f"{factor:,.0f}" if factor > 100 else f"{factor:.3g}"
    words = f"the readings are {times} times what the arm's folder predicts under loads up to "
    payload = arm.payload
    stated = "" if payload is None else f" (payload {payload:.4g} kg)"
    return f"{words}{found.beside['force']:,.5g} N{stated}: {hint}"


WORDS: Mapping[str, Callable[[Finding, Arm], str]] = {
    "frame": _frame,
    "targets": _targets,
    "mirrored": lambda *_: "lie in a left-handed frame: the sign of an axis, or two axes exchanged?",
    "axes": lambda f, _: (
        f"fit if {f.where[1]} and {f.where[2]} of the positions are exchanged"
        if len(f.where) > 2
        else f"fit if {f.where[1]} of the positions has the other sign"
    ),
    "link": lambda f, _: (
        f"fit if the end of {f.where[1]} is ({_three(f.size, MM, 0)}) mm farther, in its axes: is "
        "this the arm?"
    ),
    "joint_zero": _joint_zero,
    "joint_sign": lambda f, _: f"fit if {f.where[1]} has the other sign",
    "joint_order": _joint_order,
    "joint_coupling": _joint_coupling,
    "markers": _markers,
    "unit": lambda f, _: f"are {UNITS[f.size[0]]}",
    "angle_unit": lambda f, _: (
        f"fit if joint angles are {'radians, not degrees' if f.size[0] > 1 else 'degrees, not radians'}"
    ),
    "order": _order,
    "kinematics": lambda f, _: (
        f"the {WHICH[f.where[0]]} lie {length(f.beside['now'])} (median) from the arm's kinematics, and no "
        "single mistake explains it: is this the arm?"
    ),
    "pose": _pose,
    "reading": _reading,
    "run": _run,
    "equal": _equal,
    "repeated": lambda f, _: (
        f"run {f.where[0]} has the loaded readings of run {f.where[1]}, in another pose: copied?"
    ),
    "load_point": _load_point,
    "sign": _sign,
    "force_offset": lambda f, _: (
        f"a constant force of ({_three(f.size, 1, 0)}) N is missing in every load: the sensor's zero?"
    ),
    "tracker_moved": _moved,
    "target_moved": _moved,
    "level": _level,
    "mounting": _mounting,
    "run_load": _run_load,
    "force_axes": _force_axes,
    "levels": lambda f, _: (
        "the readings fit if the loads "
        + ("stand in reversed order" if f.where else "have each other's values")
    ),
    "scale": _scale,
    "noise": lambda f, _: (
        f"the readings scatter {f.beside['factor']:.2g} times more than their noise, "
        f"{1e6 * f.beside['sigma']:.3g} um: is it more, or does the arm do what springs do not?"
    ),
    "notation": _notation,
    "never_read": lambda f, _: f"{f.where[0]}: {', '.join(f.where[1:])} was never read and is left out",
    "unshared": lambda f, _: f"{f.where[0]}: shared that {f.where[1]}, is taken to have its own",
    "not_parted": lambda f, _: (
        f"{', '.join(f.where)}: not parted, its parts alone do not tell where their frames or mounts are"
    ),
}
"""The sentence of every kind of finding."""


def of_noise(found: Iterable[Estimate]) -> list[Doubt]:
    """Whether a model leaves far less than the stated noise alone would: whatever it lacks adds to that."""
    quiet = [own for own in found if own.f_m < QUIET * own.f_m_floor]
    if not quiet:
        return []
    least = min(quiet, key=lambda e: e.f_m / e.f_m_floor)
    free = least.regression.equations - least.regression.rank
    if gammainc(free / 2, free / 2 * (least.f_m / least.f_m_floor) ** 2) > CHANCE:
        return []
    words = (
        f"{least.structure.name} leaves F_M {least.f_m:.2g} where noise alone leaves "
        f"{least.f_m_floor:.3g}: is sigma too large ({1e6 * SIGMA[0]:g} um where none is stated), a U95 "
        "perhaps, or were readings averaged or copied?"
    )
    return [Doubt("noise", words)]
