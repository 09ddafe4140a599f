"""Serial arms of our own making, of any joints and any poses of their bodies, as folders for tests."""

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

NOTATIONS = ("quat", "axisangle", "euler", "xyaxes", "zaxis")
AXES = {"x": "1 0 0", "y": "0 1 0", "z": "0 0 1"}


def oriented(notation, rng, *, degrees):
    """A random orientation as an attribute of MJCF, in one of its notations."""
    R, scale = Rotation.random(rng=rng), rng.uniform(0.5, 2)
    unit = 180 / np.pi if degrees else 1.0
    if notation == "quat":
        numbers = scale * R.as_quat(scalar_first=True)
    elif notation == "axisangle":
        turn = R.as_rotvec()
        angle = np.linalg.norm(turn)
        numbers = [*(scale * turn / angle), unit * angle]
    elif notation == "euler":
        numbers = unit * R.as_euler("XYZ")
    elif notation == "xyaxes":
        x, y, _ = R.as_matrix().T
        numbers = [*(scale * x), *(y + 0.3 * x)]
    else:
        numbers = scale * R.as_matrix()[:, 2]
    return f'{notation}="{" ".join(repr(float(x)) for x in numbers)}"'


def write_arm(
    folder: Path, joints: str, *, pose=lambda name: "", degrees=False, reach=0.3, floor="", mount=""
) -> Path:
    """The folder of an arm.

    Args:
        folder: Where to.
        joints: A letter a joint, its axis: a small one for a hinge, a capital for a slide.
        pose: Orientation of a body by its name, as an attribute.
        degrees: Whether the file's angles are degrees.
        reach: Length of a link [m].
        floor: A geom of the world.
        mount: Pose of a body below the base, as attributes; none without.
    """
    n, limit = len(joints), 100 if degrees else 100 * np.pi / 180
    text = "".join(
        f'<body name="{name}" pos="{reach if name in ("load", "P1", "P2", "P3") else 0} {y} {z}" '
        f"{pose(name)}/>"
        for name, y, z in (("load", 0.05, 0), ("P1", 0.1, 0.2), ("P2", -0.2, 0.1), ("P3", 0.1, -0.2))
    )
    inertial = '<inertial pos="0.1 0 0" mass="{}" diaginertia="0.1 0.1 0.1"/>'
    text = f'<body name="tool" pos="{reach} 0 0" {pose("tool")}>{inertial.format(1)}{text}</body>'
    for k in range(n, -1, -1):
        joint = ""
        if k:
            axis, slide = AXES[joints[k - 1].lower()], joints[k - 1].isupper()
            ends = (0.0, 0.4) if slide else (-limit, limit)
            kind = "slide" if slide else "hinge"
            joint = f'<joint name="joint_{k}" type="{kind}" axis="{axis}" range="{ends[0]} {ends[1]}"/>'
        place = f"{reach} 0 0" if k > 1 else "0 0 0.4" if k else "0.7 -0.3 0.5" if pose("link_0") else "0 0 0"
        body = f'<body name="link_{k}" pos="{place}" {pose(f"link_{k}")}>{joint}'
        text = f"{body}{inertial.format(10 - k)}{text}</body>"
    if mount:
        text = f'<body name="mount" {mount}>{text}</body>'
    angle = "degree" if degrees else "radian"
    compiler = f'<compiler angle="{angle}" autolimits="true"/>'
    folder.mkdir(parents=True)
    (folder / "rigid.xml").write_text(
        f"<mujoco>{compiler}<worldbody>{floor}{text}</worldbody></mujoco>", encoding="utf-8"
    )
    (folder / "elastic.toml").write_text(_elastic(joints, reach), encoding="utf-8")
    return folder


def turned_arm(folder: Path, rng, joints: str) -> Path:
    """An arm whose bodies are turned at random, each in a notation of its own, on a turned mount."""
    degrees = bool(rng.integers(2))
    names = [*(f"link_{k}" for k in range(len(joints) + 1)), "tool", "load", "P1", "P2", "P3"]
    own = {name: oriented(rng.choice(NOTATIONS), rng, degrees=degrees) for name in names}
    mount = f'pos="1 2 3" {oriented(rng.choice(NOTATIONS), rng, degrees=degrees)}'
    return write_arm(folder, joints, pose=own.__getitem__, degrees=degrees, mount=mount)


def _elastic(joints: str, reach: float) -> str:
    lines = [
        'format = 1\ntitle = "made for a test"\ntool = "tool"\nload = "load"\nmarkers = ["P1", "P2", "P3"]',
        'payload = { value = 10.0, unit = "kg", origin = "assumed" }',
    ]
    for k in range(len(joints) + 1):
        axis, normal = ([1.0, 0, 0], [0.0, 1, 0]) if k else ([0.0, 0, 1], [0.0, 1, 0])
        lines.append(f'[[link]]\nname = "link_{k}"\naxis = {axis}\nnormal = {normal}')
        for name, value, unit in (
            ("length", reach, "m"),
            ("outer_diameter", 0.08 - 0.005 * k, "m"),
            ("inner_diameter", 0.02, "m"),
            ("youngs_modulus", 7e10, "Pa"),
            ("poissons_ratio", 0.33, "1"),
        ):
            lines.append(f'tube.{name} = {{ value = {value}, unit = "{unit}", origin = "assumed" }}')
    for k, joint in enumerate(joints, start=1):
        value, unit = (1e-6, "m/N") if joint.isupper() else (1e-5, "rad/(N m)")
        compliance = f'{{ value = {value}, unit = "{unit}", origin = "assumed" }}'
        lines.append(f'[[joint]]\nname = "joint_{k}"\ncompliance = {compliance}')
    return "\n".join(lines)
