"""Arms of strangers: mesh bombs, files that are none, too much of everything."""

import os
import struct
from pathlib import Path

import numpy as np
import pytest
from spoil import Spoil, holds, link, sparse

MESH = '<mesh name="m" file="{}"/>'
GEOM = '<geom type="mesh" mesh="m"/>'
OBJ = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\n"


def asset(text: str, geom: str = GEOM) -> Spoil:
    """The arm with an asset, shown by a geom of its first link."""

    def spoil(arm: Path) -> None:
        rigid = arm / "rigid.xml"
        xml = rigid.read_text().replace("<worldbody>", f"<asset>{text}</asset><worldbody>", 1)
        rigid.write_text(xml.replace("<geom", f"{geom}<geom", 4).replace(geom, "", 3))

    return spoil


def inside(text: str) -> Spoil:
    return asset("", text)


def mesh(name: str, make: Spoil) -> Spoil:
    def spoil(arm: Path) -> None:
        asset(MESH.format(name))(arm)
        make(arm / name)

    return spoil


def stl(count: int, value: float = 0.1) -> bytes:
    """Binary STL of triangles that are all the same."""
    return bytes(80) + struct.pack("<I", count) + count * struct.pack("<12fH", *[value] * 12, 0)


def surface(corners: np.ndarray, faces: np.ndarray) -> bytes:
    """Binary STL of corners, (v, 3), and triangles of them, (f, 3)."""
    rows = np.zeros(len(faces), dtype=[("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("spare", "<u2")])
    rows["corners"] = corners[faces]
    return bytes(80) + struct.pack("<I", len(faces)) + rows.tobytes()


def cylinder(count: int) -> bytes:
    """A closed one of so many triangles: each of its two ends is one plane of many corners."""
    n = count // 4
    k, turn = np.arange(n), 2 * np.pi * np.arange(n) / n
    ring = np.column_stack([np.cos(turn), np.sin(turn), 0 * turn])
    corners = 0.1 * np.concatenate([ring, ring + np.array([0, 0, 1]), [[0, 0, 0], [0, 0, 1]]])
    after = np.roll(k, -1)
    sides = [(k, after, k + n), (after, after + n, k + n), (k * 0 + 2 * n, after, k)]
    faces = [np.column_stack(own) for own in [*sides, (k * 0 + 2 * n + 1, k + n, after + n)]]
    return surface(corners, np.concatenate(faces))


def ball(count: int) -> bytes:
    """Triangles all corners of which are on a sphere."""
    corners = np.random.default_rng(0).normal(size=(3 * count, 3))
    corners *= 0.1 / np.linalg.norm(corners, axis=1, keepdims=True)
    return surface(corners, np.arange(3 * count).reshape(-1, 3))


def touching(count: int) -> Spoil:
    """The arm with so many geoms in each of two links, all in one place."""

    def spoil(arm: Path) -> None:
        rigid = arm / "rigid.xml"
        links = rigid.read_text().split("<inertial ")
        for k in (2, 4):
            links[k - 1] += '<geom size="1"/>' * count
        rigid.write_text("<inertial ".join(links))

    return spoil


ARMS: dict[str, tuple[Spoil, str]] = {
    "a supersphere": (asset('<mesh name="m" builtin="supersphere"/>'), "'builtin' is not allowed"),
    "a pipe": (mesh("a.stl", os.mkfifo), "got a folder or a device"),
    "a folder": (mesh("a.stl", Path.mkdir), "got a folder or a device"),
    "a link that leads out": (mesh("a.stl", link("/etc/passwd")), "inside the arm's folder"),
    "a link to itself": (mesh("a.stl", lambda file: file.symlink_to(file)), "a.stl: cannot be read"),
    "100 GB of nothing": (mesh("a.stl", sparse(10**11)), "expected at most 64000000 bytes"),
    "a mesh cut short": (mesh("a.stl", holds(stl(4)[:200])), "rigid.xml: MuJoCo refuses"),
    "a million triangles": (mesh("a.stl", holds(stl(10**6))), "between 1 and 200000 in STL file 'a.stl'"),
    "corners that are no number": (mesh("a.stl", holds(stl(4, value=np.nan))), "coordinate 0 is not finite"),
    "an index that is none": (mesh("a.obj", holds(f"{OBJ}f 1 2 3\nf 1 2 99\n")), "rigid.xml: MuJoCo refuses"),
    "a mesh of another kind": (mesh("a.dae", holds("<a/>")), "expected a mesh: stl, obj, msh"),
    "a texture": (asset("<texture/>"), "<texture>"),
    **{tag: (inside(f"<{tag}/>"), f"<{tag}>: not allowed") for tag in ("composite", "plugin", "include")},
    "50,000 bodies": (inside("<body/>" * 50_000), "at most 20000 elements"),
    "a million numbers": (inside(f'<geom size="{"1 " * 1_000_000}"/>'), "rigid.xml: MuJoCo refuses"),
    "250,000 pairs of geoms": (touching(500), "expected at most 50000 colliding pairs of geoms"),
    "40,000 contacts": (touching(200), "expected at most 5000 contacts in a pose"),
}


def test_sound_meshes_pass(attack, lab):
    asset(MESH.format("a.obj"))(lab / "arm")
    (lab / "arm/a.obj").write_text(f"# by hand\r\n{OBJ}f 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n")
    attack(lab, "check", "arm").done()


DEAR = {"a fine cylinder": cylinder(60_000), "a ball": ball(30_000)}
"""Meshes that pass the doors, and that convex hulls and thinning must not take minutes for."""


def robot_with(attack, lab, file):
    """A robot whose URDF shows a mesh, adopted: what is said."""
    robot = lab / "robot.urdf"
    shown = f'<visual><geometry><mesh filename="{file}"/></geometry></visual><visual>'
    robot.write_text(robot.read_text().replace("<visual>", shown, 1))
    found = attack(lab, "new", "robot", "--from", "robot.urdf")
    found.done("robot")
    return found.out


@pytest.mark.parametrize("name", DEAR)
def test_a_dear_mesh_of_an_arm_or_a_robot_takes_seconds(attack, lab, name):
    (lab / "a.stl").write_bytes(DEAR[name])
    assert "meshes not read" not in robot_with(attack, lab, "a.stl")
    mesh("a.stl", holds(DEAR[name]))(lab / "arm")
    attack(lab, "check", "arm").done()


def test_a_mesh_that_many_geoms_show_is_refused(attack, lab):
    (lab / "a.stl").write_bytes(cylinder(4000))
    geoms = GEOM * 1000
    (lab / "robot.xml").write_text(
        f"<mujoco><asset>{MESH.format('a.stl')}</asset><worldbody><body>{geoms}</body></worldbody></mujoco>"
    )
    refused = attack(lab, "new", "robot", "--from", "robot.xml")
    refused.refused("robot.xml", "<geom>", "expected at most 1000000 triangles")


@pytest.mark.parametrize("name", ARMS)
def test_a_hostile_arm_is_refused_in_one_line(attack, lab, name):
    spoil, said = ARMS[name]
    spoil(lab / "arm")
    attack(lab, "check", "arm").refused("arm/", said)


GROWING = '<!DOCTYPE m [<!ENTITY e0 "ab">{}]><COLLADA>&e20;</COLLADA>'.format(
    "".join(f'<!ENTITY e{k + 1} "{f"&e{k};" * 10}">' for k in range(20))
)
ROBOTS: dict[str, tuple[str, Spoil, str]] = {
    "a pipe": ("a.stl", os.mkfifo, "got a folder or a device"),
    "100 GB of nothing": ("a.dae", sparse(10**11), "expected at most 64000000 bytes"),
    "a mesh cut short": ("a.stl", holds(stl(4)[:200]), "expected 284 bytes of binary STL, got 200"),
    "a million triangles": ("a.stl", holds(stl(10**6)), "at most 500000 triangles"),
    "no mesh": ("a.ply", holds("not a mesh"), "not read as ply"),
    "XML of another kind": ("a.dae", holds("<a/>"), "not read as dae"),
    "entities that grow": ("a.dae", holds(GROWING), "not read as dae"),
}


@pytest.mark.parametrize("name", ROBOTS)
def test_a_robot_goes_without_a_hostile_mesh_and_says_so(attack, lab, name):
    file, make, said = ROBOTS[name]
    make(lab / file)
    out = robot_with(attack, lab, file)
    assert "meshes not read" in out
    assert said in out
