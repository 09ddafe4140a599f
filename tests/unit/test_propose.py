"""What is proposed for a robot whose file holds kinematics and shapes alone."""

import tomllib

import numpy as np
import pytest

from testbench.cli.new import read_user_inputs
from testbench.errors import BenchError
from testbench.files.robot.robot import (
    Body,
    ImportedChain,
    ImportedJoint,
    ImportedMesh,
    ImportedShape,
    ImportedSite,
    pose_of,
)
from testbench.workflows.new_arm import (
    SPREAD,
    UserInputs,
    elastic_toml,
    joint_compliance,
    outer_diameter,
    propose,
    triangles,
)

Z = np.array([0.0, 0.0, 1.0])
KNOWN = [  # payload [kg], stretched reach [m], joints counted from 0 and their compliances [1e-6 rad/(N m)]
    (500, 3.116, 0, [1 / 2.3, 1 / 8.6, 1 / 2.8, 1 / 3.0, 1 / 0.2, 1 / 0.9]),  # KR 500, modal test
    (270, 2.916, 1, [0.302, 0.406, 3.002, 3.303, 2.365]),  # KR 270, elastostatic
    (10, 1.556, 1, [10.7, 5.7]),  # UR10, from its tracker readings
]


def tube(length, outer, inner, axis, aside=(0.0, 0.0, 0.0), sides=64):
    """A tube with its bore, along an axis, beside the origin."""
    angle = 2 * np.pi * np.arange(sides) / sides
    y = np.cross(axis, [0.3, -0.5, 0.8])
    y /= np.linalg.norm(y)
    ring = np.outer(np.cos(angle), y) + np.outer(np.sin(angle), np.cross(axis, y))
    rings = [d / 2 * ring + end * np.asarray(axis) for d in (outer, inner) for end in (0.0, length)]
    faces = []
    for start in (0, 2 * sides):
        for k in range(sides):
            a, b = start + k, start + (k + 1) % sides
            faces += [[a, b, a + sides], [b, b + sides, a + sides]]
    corners = np.concatenate(rings) + aside
    mesh = ImportedMesh(corners, np.array(faces), corners)
    return ImportedShape("mesh", np.zeros(3), np.eye(4), mesh, np.ones(4), visual=True, collides=True)


def part(name, offset, axis=Z, shapes=(), sites=(), prismatic=False):
    joint = (
        None if axis is None else ImportedJoint(f"{name}_joint", np.array(axis), prismatic, -2.0, 2.0, True)
    )
    weight = {"mass": 5.0, "com": np.full(3, 0.01), "inertia": np.eye(3)}
    return Body(name, -1, pose_of(np.eye(3), offset), joint, shapes=(*shapes,), sites=(*sites,), **weight)


def chain_of(*parts, tip=(0.0, 0.0, 0.1)):
    end = ImportedSite("flange", pose_of(np.eye(3), tip))
    return ImportedChain("robot", (part("base", (0, 0, 0), None), *parts), end, ())


def elastic_of(arm, wishes):
    return elastic_toml(arm, wishes, propose(arm, wishes))


@pytest.mark.parametrize("aside", [(0.0, 0.0, 0.0), (0.02, 0.3, -0.1)], ids=["on", "beside the line"])
def test_the_diameter_of_a_drawn_tube_is_recovered_wherever_it_stands(aside):
    axis = np.array([2.0, 1.0, 2.0]) / 3
    y = np.array([1.0, -2.0, 0.0]) / np.sqrt(5)
    frame = np.column_stack([axis, y, np.cross(axis, y)])
    surface = triangles([tube(0.8, 0.14, 0.12, axis, aside)])
    found = outer_diameter(surface, frame, (0.1, 0.7))
    # a polygon of 64 sides has 0.9992 of the circle's diameter
    assert found == pytest.approx(0.14, rel=2e-3)


def test_beams_run_from_joint_to_joint_and_tubes_have_the_drawn_diameter():
    y = np.array([0.0, 1.0, 0.0])
    arm = chain_of(
        part("column", (0, 0, 0.4)),
        part("upper", (0.1, 0, 0.2), y, [tube(0.6, 0.12, 0.1, [1.0, 0, 0])]),
        part("fore", (0.6, 0, 0), y, [tube(0.5, 0.08, 0.07, [0.6, 0, 0.8])]),
        part("wrist", (0.3, 0, 0.4), y, [tube(0.2, 0.06, 0.05, Z)]),
        part("hand", (0, 0, 0), Z, [tube(0.2, 0.06, 0.05, Z)]),
        tip=(0, 0, 0.2),
    )
    elastic = elastic_of(arm, UserInputs(payload=12.0))
    made = tomllib.loads(elastic)
    links = {link["name"]: link for link in made["link"]}
    axes = [links[name]["axis"] for name in ("upper", "fore", "wrist")]  # the wrist's joints meet in a point
    np.testing.assert_allclose(axes, [[1, 0, 0], [0.6, 0, 0.8], [0, 0, 1]], atol=1e-9)
    np.testing.assert_allclose(links["upper"]["normal"], [0, 1, 0], atol=1e-9)  # along a joint's axis
    for name, length, outer in (("upper", 0.6, 0.12), ("fore", 0.5, 0.08), ("wrist", 0.03, 0.06)):
        tube_ = links[name]["tube"]  # the wrist is as long as half its diameter
        assert tube_["length"]["value"] == pytest.approx(length, rel=2e-3)
        assert tube_["outer_diameter"]["value"] == pytest.approx(outer, rel=2e-3)
    assert "no shape" in links["column"]["tube"]["outer_diameter"]["note"]
    origins = {q["origin"] for link in made["link"] for q in link["tube"].values()}
    assert origins | {j["compliance"]["origin"] for j in made["joint"]} == {"estimated"}
    assert made["payload"]["value"] == 12.0
    assert len(elastic.splitlines()) < 120
    for link in made["link"]:
        x, y = np.array(link["axis"]), np.array(link["normal"])
        np.testing.assert_allclose([x @ x, y @ y, x @ y], [1, 1, 0], atol=1e-8)


def test_a_link_that_no_tube_can_be_is_named():
    arm = chain_of(part("a", (0, 0, 0.1)), part("b", (0, 0, 0.1), shapes=[tube(0.1, 2e-4, 1e-4, Z)]))
    with pytest.raises(BenchError, match="tube of link 'b': outer_diameter: expected"):
        propose(arm, UserInputs(payload=12.0))


def test_the_law_of_the_joints_misses_the_known_ones_by_the_factor_that_it_says():
    missed = [
        np.log(joint_compliance(payload, reach, first + k, 6, slides=False) / (1e-6 * c))
        for payload, reach, first, known in KNOWN
        for k, c in enumerate(known)
    ]
    assert np.exp(np.sqrt(np.mean(np.square(missed)))) == pytest.approx(SPREAD, rel=0.03)
    assert abs(np.mean(missed)) < np.log(1.1)


def test_a_slide_is_proposed_in_metres_a_newton():
    slide = part("slide", (0, 0, 0.4), Z, prismatic=True)
    arm = chain_of(slide, part("two", (0.5, 0, 0)), part("three", (0.5, 0, 0)))
    [first, second, _] = tomllib.loads(elastic_of(arm, UserInputs(payload=4.0)))["joint"]
    assert first["compliance"]["unit"] == "m/N"
    lever = 0.1 * 1.1  # of the reach from the first joint to the tool
    assert first["compliance"]["value"] == pytest.approx(second["compliance"]["value"] * lever**2, rel=0.05)


def test_sites_of_the_tool_are_markers_unless_they_lie_on_a_line():
    def markers(places):
        sites = [ImportedSite(f"m{k}", pose_of(np.eye(3), place)) for k, place in enumerate(places)]
        arm = chain_of(part("one", (0, 0, 0.4)), part("two", (0.5, 0, 0), Z, (), sites))
        return propose(arm, UserInputs()).markers

    places = np.array([[0.1, 0, 0], [0, 0.1, 0], [-0.1, 0, 0.05]])
    found = markers(places)
    assert [name for name, _ in found] == ["m0", "m1", "m2"]
    np.testing.assert_allclose([p for _, p in found], places - [0, 0, 0.1], atol=1e-12)  # in the tool's frame
    found = markers(0.1 * np.outer(range(3), [1, 0, 0]))
    assert [name for name, _ in found] == ["P1", "P2", "P3"]
    away = np.linalg.norm([p for _, p in found], axis=1)
    np.testing.assert_allclose(away, 0.06, atol=1e-3)  # a tenth of 0.5 + 0.1 m


def test_flags_are_taken_as_they_are_said():
    wishes = read_user_inputs(7.0, "0,0,0.2,90,0,0", ["A=0,0,0", "B=0.1,0,0", "C=0,0.1,0"], "0,0,0.05")
    proposal = propose(chain_of(part("one", (0, 0, 0.4)), part("two", (0.5, 0, 0))), wishes)
    np.testing.assert_allclose(proposal.tool.pose[:3, 3], [0, 0, 0.3])
    np.testing.assert_allclose(proposal.tool.pose[:3, 2], [0, -1, 0], atol=1e-15)  # turned about its x
    np.testing.assert_array_equal(proposal.load[1], [0, 0, 0.05])
    assert [name for name, _ in proposal.markers] == ["A", "B", "C"]


@pytest.mark.parametrize(
    ("flags", "words"),
    [
        ((0.0, None, [], None), "--payload-kg: expected 0.001 to 10000 kg, got 0.0"),
        ((None, "1,2", [], None), "--tool: expected 3 or 6 numbers with commas"),
        ((None, "1,2,x", [], None), "--tool: expected 3 or 6 numbers with commas between them"),
        ((None, None, ["A=0,0,0", "B=1,0,0"], None), "--marker: expected three markers or more, got 2"),
        ((None, None, ["A"], None), "--marker: expected NAME=x,y,z"),
        ((None, None, [], "0,0,350"), "--load: expected metres up to 10"),
        ((None, None, [], "0,0,nan"), "--load: expected 3 numbers with commas between them"),
    ],
)
def test_a_wrong_flag_is_named(flags, words):
    with pytest.raises(BenchError, match=words.replace("(", r"\(")):
        read_user_inputs(*flags)


def test_what_nobody_stated_is_to_be_confirmed_the_payload_first_and_nothing_else():
    arm = chain_of(part("tool", (0, 0, 0.4)), part("two", (0.5, 0, 0)), part("three", (0.5, 0, 0)))
    elastic, stated = (
        elastic_of(arm, own) for own in (UserInputs(), read_user_inputs(4.0, None, [], "0,0,0.1"))
    )
    made = tomllib.loads(elastic)
    assert (made["payload"]["value"], made["payload"]["origin"]) == (4.9, "estimated")
    first = next(line for line in elastic.splitlines() if line.startswith("#  1."))
    assert "payload 4.9 kg, from the arm's mass of 20 kg and reach of 1.10 m" in first
    assert "payload" not in stated.split("format = 1")[0]
    assert made["tool"] == "tool_"  # the robot has a part of that name
    assert made["to_confirm"] == ["tool_", "load", "P1", "P2", "P3"]
    assert tomllib.loads(stated)["to_confirm"] == ["tool_", "P1", "P2", "P3"]
