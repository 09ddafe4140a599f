"""What the payload touches and what hides a target, against geometry worked out by hand and by Pinocchio."""

import shutil

import mujoco
import numpy as np
import pytest
from loads import random_q

from testbench import BenchError, load_arm
from testbench.errors import PoseError
from testbench.model.vjm import tool_points
from testbench.plant import rigid_cell as places
from testbench.plant.rigid_cell import (
    Contact,
    Payload,
    build_rigid_cell,
    find_collisions,
    find_contacts,
    find_hidden_markers,
    has_surroundings,
)
from testbench.plant.shapes import rigid_frames

STATION = (4.5, -2.5, 1.6)
READY = np.deg2rad([[10.0, -70, 80, 20, -35, 15]])
"""A pose of the KR 500 in which 460.3 kg hang clear, and STATION sees all markers."""


def load_point(cell, q=READY):
    return tool_points(cell.vjm, q, cell.vjm.load_point[None])[0, 0]


def altered(cell, tmp_path, *changes):
    """The arm with text of its rigid.xml replaced."""
    folder = shutil.copytree(cell.arm.mjcf_path.parent, tmp_path / cell.arm.name, dirs_exist_ok=True)
    text = (folder / "rigid.xml").read_text()
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    (folder / "rigid.xml").write_text(text)
    return load_arm(folder)


def furnished(cell, tmp_path, geom):
    """The arm with one more geom in the world."""
    return altered(cell, tmp_path, ("<worldbody>", f"<worldbody>{geom}"))


def test_a_floor_that_is_laid_is_one_that_stands_in_the_file(kr500, tmp_path, rng):
    floor = '<geom name="floor" type="plane" size="5 5 0.1" material="floor"/>'
    raised = altered(kr500, tmp_path / "raised", (floor, floor.replace("/>", ' pos="0 0 0.3"/>')))
    bare = altered(kr500, tmp_path / "bare", (floor, ""))
    q = random_q(kr500, rng, 300)
    assert find_contacts(build_rigid_cell(bare, floor_height=0.3), q) == find_contacts(
        build_rigid_cell(raised), q
    )
    assert find_collisions(build_rigid_cell(bare, floor_height=0.3), q) == find_collisions(
        build_rigid_cell(raised), q
    )
    assert find_collisions(build_rigid_cell(bare), q) != find_collisions(
        build_rigid_cell(bare, floor_height=0.3), q
    )
    assert has_surroundings(build_rigid_cell(raised))
    assert has_surroundings(build_rigid_cell(bare, floor_height=0.3))
    assert not has_surroundings(build_rigid_cell(bare))


def test_alone_the_arm_touches_itself_and_the_floor(kr500, arm_6r, rng):
    touching = [c for c in find_contacts(kr500.room, random_q(kr500, rng, 300)) if c]
    assert {c.category for c in touching} == {"itself", "room"}
    assert all((c.bodies[1] == "world") == (c.category == "room") for c in touching)
    assert not any(find_contacts(arm_6r.room, random_q(arm_6r, rng, 300)))  # it has no shapes that collide
    assert not (kr500.room.model.geom_group == 5).any()  # groups of rays are of a model of their own


def test_a_pose_beyond_a_limit_is_named(kr500):
    q = np.array(READY)
    places.check_poses(kr500.room, q)
    for end in kr500.arm.limits[:, 1] + [-0.01, 0.01]:
        beyond = np.vstack([q, q])
        beyond[1, 1] = end
        with pytest.raises(PoseError, match=r"pose 2: joint_2: expected .* deg, got"):
            places.check_poses(kr500.room, beyond)


def test_the_weight_is_a_steel_cylinder_and_names_of_the_model_are_left_to_its_owner(kr500, tmp_path):
    payload = Payload(460.3)
    d = payload.diameter
    assert np.pi / 4 * d**3 * 7850 == pytest.approx(460.3, rel=1e-12)  # rounding
    model = build_rigid_cell(kr500.arm, payload).model
    weight = np.flatnonzero(model.geom_bodyid == model.body("payload").id)[0]
    np.testing.assert_allclose(model.geom_size[weight, :2], d / 2, rtol=1e-15)
    stands = '<body name="payload"/><body name="tracker"/>'
    sling = load_point(kr500)[2] - 0.3
    arm = furnished(kr500, tmp_path, stands)
    found = find_contacts(build_rigid_cell(arm, Payload(460.3, sling_length=sling), STATION), READY)
    assert found == [Contact("payload", ("world", "payload_"))]


@pytest.mark.parametrize(
    ("gap", "clear"), [(-0.01, False), (0.0, False), (0.04, False), (0.051, True), (0.06, True)]
)
def test_the_weight_hangs_above_the_floor_by_its_clearance(kr500, gap, clear):
    """By Pinocchio's load point; the sling is as long as leaves the gap below the weight."""
    sling = load_point(kr500)[2] - Payload(460.3).diameter - gap
    site = build_rigid_cell(kr500.arm, Payload(460.3, sling_length=sling, clearance=0.05))
    expected = None if clear else Contact("payload", ("world", "payload"))
    assert find_contacts(site, READY) == [expected]


PLAIN = 'contype="1" conaffinity="1"'
CHANGES = {
    "none": (),
    "margins of its own": (('group="3"', 'group="3" margin="0.2"'),),
    "bits of its own": ((PLAIN, 'contype="64" conaffinity="0"'),),
}


@pytest.mark.parametrize("change", CHANGES)
def test_what_payload_and_tracker_touch_is_what_is_nearer_than_the_clearance(kr500, tmp_path, rng, change):
    """Against MuJoCo's distances, pair by pair: no broad phase, no filter, no margin, no bits."""
    q, payload = random_q(kr500, rng, 300), Payload(460.3)
    site = build_rigid_cell(altered(kr500, tmp_path, *CHANGES[change]), payload, (1.2, -1.6, 1.2))
    model, data = site.model, mujoco.MjData(site.model)
    hanging, head = (
        np.flatnonzero(site.geom_categories == places.CONTACT_CATEGORIES.index(name))
        for name in ("payload", "tracker")
    )
    others = np.flatnonzero(
        (site.geom_categories != places.CONTACT_CATEGORIES.index("payload")) & (model.geom_contype != 0)
    )
    arm = np.flatnonzero(
        (site.geom_categories == places.CONTACT_CATEGORIES.index("itself")) & (model.geom_contype != 0)
    )
    assert model.geom_size[head, 0] == places.TRACKER_HEAD_RADIUS
    found = find_contacts(site, q)
    loads = tool_points(kr500.vjm, q, kr500.vjm.load_point[None])[:, 0]

    def nearest(some, more):
        return min(mujoco.mj_geomDistance(model, data, a, b, 1.0, None) for a in some for b in more)

    for pose, load, contact in zip(q, loads, found, strict=True):
        data.qpos[site.joint_addresses], data.qpos[site.payload_addresses] = pose, load
        mujoco.mj_kinematics(model, data)
        kind = contact and contact.category
        if kind in (None, "payload"):  # others are told before the payload
            assert (nearest(hanging, others) < payload.clearance) == (kind == "payload")
        if kind not in ("itself", "room"):
            assert (nearest(head, arm) < 0) == (kind == "tracker")
    touched = {c.bodies for c in found if c is not None}
    assert {(body, "payload") for body in ("link_3", "tool", "world", "tracker")} <= touched
    assert ("link_3", "tracker") in touched
    assert any(c and c.category == "itself" for c in found) == (change != "bits of its own")


@pytest.mark.parametrize(
    ("name", "station", "said"),
    [
        ("kr500", (0.0, 0.0, 0.3), "station at .*0.3.* is inside link_0, which"),
        ("kr500", (0.5, -0.65, 0.1), "station at .*0.1.* is inside world, which"),
        ("kr500", (4.5, -2.5, -1.0), "station at .*-1 m.* is inside world, which"),
        ("arm_6r", (0.1, 0.0, 0.4), "station at .*0.4.* is inside link_0, which"),
        ("kr500", (np.nan, 0, 1), "position of the station"),
        ("kr500", (5e3, 0, 1), "position of the station"),
        ("kr500", (1, 2), "position of the station"),
        ("kr500", None, "expected a cell with a tracker"),
    ],
)
def test_a_tracker_inside_what_does_not_move_or_nowhere_is_refused_in_one_line(name, station, said, request):
    with pytest.raises(BenchError, match=said) as err:
        find_hidden_markers(
            build_rigid_cell(request.getfixturevalue(name).arm, tracker_position=station), READY
        )
    assert "\n" not in str(err.value)


def test_the_ready_pose_is_seen_and_a_wall_hides_it(kr500, tmp_path):
    """Whether the wall is drawn, only collides, or is fully transparent."""
    assert find_hidden_markers(build_rigid_cell(kr500.arm, Payload(460.3), STATION), READY) == [None]
    middle = (tool_points(kr500.vjm, READY, kr500.vjm.markers)[0, 0] + STATION) / 2
    wall = f'type="sphere" size="0.3" pos="{" ".join(map(str, middle))}"'
    for looks in ("", 'group="3"', 'rgba="1 1 1 0"', 'contype="0" conaffinity="0"'):
        arm = furnished(kr500, tmp_path, f"<geom {wall} {looks}/>")
        assert find_hidden_markers(build_rigid_cell(arm, Payload(460.3), STATION), READY) == [
            ("P1", "world")
        ], looks


@pytest.mark.parametrize("name", ["kr500", "arm_6r"])
def test_a_ball_hides_a_target_where_it_meets_the_line_of_sight(name, request, tmp_path, rng):
    """Distance of the ball's centre from the segment station to target, by Pinocchio's kinematics."""
    cell = request.getfixturevalue(name)
    q = random_q(cell, rng, 300)
    centre, radius, station = np.array([2.5, -1.5, 1.8]), 0.5, np.array(STATION)
    ball = f'<geom type="sphere" size="{radius}" pos="2.5 -1.5 1.8"/>'
    arm = furnished(cell, tmp_path, ball)
    by_arm = np.array(
        [h is not None for h in find_hidden_markers(build_rigid_cell(cell.arm, tracker_position=STATION), q)]
    )
    by_both = np.array(
        [h is not None for h in find_hidden_markers(build_rigid_cell(arm, tracker_position=STATION), q)]
    )
    beams = tool_points(cell.vjm, q, cell.vjm.markers) - station
    beams *= 1 - places.TARGET_RADIUS / np.linalg.norm(beams, axis=2, keepdims=True)
    along = np.clip((beams @ (centre - station)) / (beams**2).sum(axis=2), 0, 1)
    distance = np.linalg.norm(station + along[:, :, None] * beams - centre, axis=2)
    sure = np.abs(distance - radius).min(axis=1) > 1e-9  # rounding decides nothing
    by_ball = (distance < radius).any(axis=1)
    assert 10 < (by_ball & ~by_arm).sum() < (~by_arm).sum()
    np.testing.assert_array_equal(by_both[sure], (by_arm | by_ball)[sure])


def test_padding_and_the_end_of_its_holder_hide_no_target_but_another_thing_near_by_does(kr500, tmp_path):
    """A ray is stopped by what is drawn of a body, and by what collides only where nothing is drawn."""
    P1 = '<body name="P1" pos="0.12 0.40 0.24">'
    hull = '<geom class="collision" type="sphere" size="0.3" pos="0.12 0.40 0.24"/>'
    arm = altered(kr500, tmp_path, (P1, hull + P1))
    assert find_hidden_markers(build_rigid_cell(arm, tracker_position=STATION), READY) == [None]
    bare = altered(kr500, tmp_path, (P1, f'<body name="case">{hull}</body>{P1}'))
    assert find_hidden_markers(build_rigid_cell(bare, tracker_position=STATION), READY) == [("P1", "case")]
    P1 = tool_points(kr500.vjm, READY, kr500.vjm.markers)[0, 0]
    toward = (np.array(STATION) - P1) / np.linalg.norm(np.array(STATION) - P1)
    for beyond, expected in ((-0.005, None), (0.005, ("P1", "world"))):
        bead = (
            P1 + (places.TARGET_RADIUS + beyond - 0.001) * toward
        )  # its face towards the tracker is 1 mm nearer
        geom = f'<geom type="sphere" size="0.001" pos="{" ".join(map(repr, bead.tolist()))}"/>'
        site = build_rigid_cell(furnished(kr500, tmp_path, geom), tracker_position=STATION)
        assert find_hidden_markers(site, READY) == [expected]


def test_targets_face_along_the_z_axis_of_their_bodies(kr500, tmp_path, rng):
    marker = '<body name="P2" pos="0.48 -0.32 0.26"'
    arm = altered(kr500, tmp_path, (marker, f'{marker} quat="0.8 0.1 -0.5 0.3"'))
    room = build_rigid_cell(arm)
    facing = room.marker_directions
    np.testing.assert_allclose(facing[[0, 2]], [[0, 0, 1]] * 2, atol=1e-15)  # rounding, as below
    frames = rigid_frames(room, random_q(kr500, rng, 1))
    names = room.body_names
    tool, P2 = frames.rotations[0, names.index("tool")], frames.rotations[0, names.index("P2")]
    np.testing.assert_allclose(tool @ facing[1], P2[:, 2], atol=1e-14)
    assert abs(facing[1, 2]) < 0.9


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"mass": 0.0}, "mass of the payload: expected a finite number above 0, got 0.0"),
        ({"density": -1.0}, "density of the payload: .* got -1.0"),
        ({"clearance": -0.01}, r"clearance \[m\] of the payload: .* got -0.01"),
        ({"sling_length": 0.1}, r"sling_length \[m\] of the payload: expected more than 0.17 .* got 0.1"),
    ],
)
def test_a_payload_that_makes_no_sense_is_refused(wrong, message):
    with pytest.raises(BenchError, match=message):
        Payload(**{"mass": 460.3, **wrong})
