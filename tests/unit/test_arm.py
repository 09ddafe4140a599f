"""An arm's folder is read exactly, or refused in one line: which file, where, and what was expected."""

import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from refused import refused
from spoil import swap

from testbench.arm.document import MAX_NESTING
from testbench.arm.folder import find_arm, load_arm
from testbench.arm.mjcf import read_mjcf

MODELS = Path(__file__).parents[2] / "models"
LENGTH, AXIS = r"(?<=tube\.length = \{ value = )[^,]+", r"(?<=axis = )\[.*?\]"
PAYLOAD, JOINT = r"(?<=payload = \{ value = )[^,]+", r"(?<=\ncompliance = \{ value = )[^,]+"


def copy_arm(tmp_path, name="arm_6r"):
    return Path(shutil.copytree(MODELS / name, tmp_path / name))


# What is right


@pytest.mark.parametrize(
    ("pattern", "new"),
    [
        (r"\A", "\ufeff"),
        (r"7\.000e10", "70000000000"),
        (AXIS, "[0, 0, 1]"),
        (r"(?<=axis = )\[1\.0, 0\.0, 0\.0\]", "[0.9999999999, 0.0, 0.0]"),
    ],
    ids=["a byte order mark", "an integer", "integers", "rounded"],
)
def test_the_same_arm_may_be_written_otherwise(tmp_path, pattern, new):
    folder = copy_arm(tmp_path)
    swap(pattern, new)(folder / "elastic.toml")
    if new == "\ufeff":
        swap(pattern, new)(folder / "rigid.xml")
    a, b = load_arm(folder), load_arm(MODELS / "arm_6r")
    np.testing.assert_array_equal(a.C_theta, b.C_theta)
    np.testing.assert_array_equal(a.limits, b.limits)
    np.testing.assert_array_equal([x.beam_axes for x in a.links], [x.beam_axes for x in b.links])
    assert (a.tool, a.load_point, a.markers) == (b.tool, b.load_point, b.markers)


@pytest.mark.parametrize(
    ("compiler", "unit"),
    [("<compiler/>", np.pi / 180), ('<compiler angle="radian"/><compiler meshdir="."/>', 1.0)],
)
def test_limits_are_degrees_unless_the_compiler_says_radian(tmp_path, compiler, unit):
    folder = copy_arm(tmp_path)
    swap(r"<compiler .*?/>", compiler)(folder / "rigid.xml")
    swap(r'(?<=name="joint_2")(.*?)range=".*?"', ' axis="0 1 0" range="-90 45"')(folder / "rigid.xml")
    np.testing.assert_allclose(load_arm(folder).limits[:, 1], [-90 * unit, 45 * unit], rtol=1e-15)


# The folder


def test_what_is_no_folder_of_an_arm_is_named(tmp_path):
    folder = copy_arm(tmp_path)
    for path in (tmp_path / "no_such_arm", tmp_path / "nul\0byte", folder / "rigid.xml"):
        assert "expected the folder of an arm, with rigid.xml and elastic.toml" in refused(load_arm, path)
    (folder / "rigid.xml").write_bytes(b"")
    assert "rigid.xml" in refused(load_arm, folder)
    (folder / "elastic.toml").unlink()
    assert re.search(r"elastic\.toml.*No such file", refused(load_arm, folder))


@pytest.mark.parametrize("name", ["rigid.xml", "elastic.toml"])
def test_what_is_no_file_of_text_is_refused(tmp_path, name):
    folder = copy_arm(tmp_path)
    file = folder / name
    file.write_bytes(file.read_bytes()[:20] + "Stahlträger".encode("latin-1"))
    assert f"{name}: byte 28: expected UTF-8" in refused(load_arm, folder)
    file.unlink()
    file.mkdir()
    assert "expected a file, got a folder or a device" in refused(load_arm, folder)
    file.rmdir()
    file.symlink_to("/dev/zero")  # endless
    assert "expected a file, got a folder or a device" in refused(load_arm, folder)


# elastic.toml

SLIDE = "joint (joint_1) compliance.unit: expected rad/(N m) for a hinge, got m/N"
EITHER = ["link.0 (link_0)", "expected either a tube or a compliance"]
COMPLIANCE = 'compliance = { value = [], unit = "m/N, rad/(N m)", origin = "assumed" }'
WRONG_TOML = {
    "too large a file": (r"\A", "#" * 100_000 + "\n", ["expected at most 100000 bytes"]),
    "an end without a beginning": ("format = 1", "format = = 1", ["not TOML", "(at line 4, column 10)"]),
    "garbage is not repeated": (r"\A", f'"{"x" * 50_000}" = 1\n', ["..."]),
    "lists without end": (r"\A", f"x = {'[' * 40_000}\n", ["elastic.toml: not TOML"]),
    "tables without end": (r"\A", f"x = {'{a=' * 20_000}\n", ["elastic.toml: not TOML"]),
    "deep lists": (r"\A", f"x = {'[' * 200}{']' * 200}\n", ["elastic.toml: line 1, column 1, x: "]),
    "a dotted key without end": (r"\A", f"x{'.x' * 40_000} = 1\n", ["line 1: expected at most 200 dots"]),
    "5000 digits": (LENGTH, "9" * 5000, ["not TOML"]),
    "9000 digits": (LENGTH, "0x" + "f" * 9000, ["length.value: "]),
    "400 digits": (LENGTH, "9" * 400, ["expected a number"]),
    "a key of two lines": (r"\A", '"a\\nb" = 1\n', ["a b: unknown key"]),
    "a name of two lines": (r'tool = "tool"', 'tool = "to\\nol"', ["tool: "]),
    "an unknown key at the top": (r"\A", "colour = 1\n", ["colour: unknown key"]),
    "another format": (r"format = 1", "format = 2", ["format: expected 1, got 2"]),
    "a boolean for a number": (LENGTH, "true", ["link.0.tube.length.value", "expected a number, got True"]),
    "no axis": (r"axis = \[1.*\n", "", ["line 21, column 3, link.1.axis: this key is missing"]),
    "no markers": (r"markers = .*", "markers = []", ["markers: expected a list of at least 1, got []"]),
    "NaN": (LENGTH, "nan", ["line 15, column 17, link.0.tube.length.value", "finite number", "got nan"]),
    "a wrong unit": (r'unit = "m"', 'unit = "mm"', ["line 15, column 30, link.0.tube.length.unit", "'mm'"]),
    "a wrong origin": (r'"assumed"', '"guess"', ["payload.origin", "'inferred', 'assumed' or 'estimated'"]),
    "a slide's compliance for a hinge": (r'(?<=unit = )"rad/\(N m\)"', '"m/N"', [SLIDE]),
    "a payload in tonnes": (PAYLOAD, "0.0001", ["payload: expected 0.001 to 10000 kg, got 0.0001"]),
    "a zero length": (LENGTH, "0.0", ["link.0.tube (link_0)", "length: expected 0.001 to 100 m, got 0.0"]),
    "a tube of 99 m": (LENGTH, "99.0", ["link.0.tube.length (link_0)", "expected at most", "got 99 m"]),
    "a point that is not there": (r"(markers = .*)", 'markers = ["probe"]\nto_confirm = ["P9"]', ["'P9'"]),
    "both a tube and a compliance": (r"axis = ", f"{COMPLIANCE}\naxis = ", EITHER),
    "neither": (r"(tube\..*\n)+", "\n", EITHER),
    "an axis that is no unit vector": (AXIS, "[0.0, 0.0, 1.001]", ["link.0.axis (link_0)", "unit vectors"]),
    "an axis along the normal": (AXIS, "[0.0, 1.0, 0.0]", ["link.0.axis (link_0)", "at right angles"]),
    "a zero joint compliance": (JOINT, "0.0", ["joint.0.compliance: ", "expected 1e-18 to 1000"]),
    "one joint too few": (r"\[\[joint\]\]\n.*\n.*\n", "", ["link: ", "got 7 links and 5 joints"]),
    "a joint named twice": (r'"joint_2"', '"joint_1"', ["joint: expected different names"]),
    "a tool in the middle": (r'"tool"', '"link_3"', ["'link_3'>: expected as a direct child of"]),
    "an unknown load point": (r"load = .*", 'load = "P9"', ["no load point 'P9'; bodies are load"]),
    "an unknown marker": (r"markers = .*", 'markers = ["P9"]', ["no marker 'P9'; bodies are load, pr"]),
}
HEAVY, ENTRY, FOOT = "kr500_l480", r"8\.01e-5", r"\[-0.49, 0.3, -0.26\]"
WRONG_OF_OTHERS = {
    "rows of other lengths": (
        "single_link",
        r"(?<=value = \[\n).*?\],",
        "[1.0],",
        ["link.0.compliance (link_0): compliance: expected numbers"],
    ),
    "no number": ("single_link", ENTRY, "nan", ["link.0.compliance.value.1.1: ", "finite number"]),
    "a negative rate": (HEAVY, "6.2e4", "-1.0", ["compensator", "rate", "expected 0 to 1e+09 N/m, got -1"]),
    "a rate a millimetre": (HEAVY, r"(?<=6.2e4, unit = ).N/m.", '"N/mm"', ["compensator", "unit", "N/m"]),
    "a foot in mm": (HEAVY, FOOT, "[-490, 300, -260]", ["compensator", "foot", "expected -100 to 100 m"]),
}


def test_a_compliance_is_symmetric_but_for_rounding(tmp_path):
    folder = copy_arm(tmp_path, "single_link")
    C = load_arm(folder).links[0].compliance.copy()

    def write(entry):
        C[1, 5] = entry
        swap(r"value = \[[\s\S]*?\],?\s*\]", f"value = {C.tolist()}")(folder / "elastic.toml")

    write(C[5, 1] * (1 + 1e-12))
    read = load_arm(folder).links[0].compliance
    np.testing.assert_array_equal(read, read.T)
    write(2.0e-4)
    line = refused(load_arm, folder)
    assert "link.0.compliance (link_0): compliance: expected a symmetric matrix" in line
    assert "0.0002 at row 2, column 6 against 0.000398 at row 6, column 2" in line


# rigid.xml against elastic.toml

HINGE = r'<joint name="joint_2".*?/>'


def hinge(attributes):
    return f'<joint name="joint_2" {attributes}/>'


WRONG_CHAIN = {
    "a missing body": (r'name="link_2"', 'name="arm"', ["no body 'link_2'; bodies are link_0"]),
    "a missing joint": (HINGE, "", ["<body name='link_2'>", "exactly the joint 'joint_2'", "got none"]),
    "a wrong joint name": (r'name="joint_2"', 'name="a"', ["<body name='link_2'>", "'joint_2'", "got a"]),
    "a ball joint": (
        HINGE,
        hinge('type="ball" axis="0 1 0" range="-1 1"'),
        ["'joint_2'>: expected a hinge or a slide, got 'ball'"],
    ),
    "a joint off its body's origin": (r'name="joint_2"', 'name="joint_2" pos="0 0 0.1"', ["expected no pos"]),
    "a missing range": (HINGE, hinge('axis="0 1 0"'), ["<joint name='joint_2'>", "attribute range of 2"]),
    "an inverted range": (HINGE, hinge('axis="0 1 0" range="1 -1"'), ["expected lower < upper, got '1"]),
    "a range too wide to draw from": (
        HINGE,
        hinge('axis="0 1 0" range="-1e308 1e308"'),
        ["<joint name='joint_2'>: range: expected 2 number(s) up to 1e+06"],
    ),
    "a zero axis": (HINGE, hinge('axis="0 0 0" range="-1 1"'), ["axis: expected a direction, got zero"]),
    "a joint of the base": (
        r'<body name="link_1"',
        '<joint name="track"/><body name="link_1"',
        ["<joint>: expected the joints joint_1", "no other", "track"],
    ),
    "a missing inertial": (r'<inertial pos="0.45.*?/>', "", ["'link_2'>", "expected an <inertial>"]),
    "a missing load point": (r'name="load"', 'name="hook"', ["<body name='tool'>: no load point 'load'"]),
    "a missing marker": (r'name="probe"', 'name="P1"', ["'tool'>: no marker 'probe'; bodies are load, "]),
    "a duplicate marker": (r'(?=<body name="load")', '<body name="probe"/>', ["2 bodies 'probe'"]),
}
WRONG = {
    **{name: ("arm_6r", "elastic.toml", *case) for name, case in WRONG_TOML.items()},
    **{name: (arm, "elastic.toml", *case) for name, (arm, *case) in WRONG_OF_OTHERS.items()},
    **{name: ("arm_6r", "rigid.xml", *case) for name, case in WRONG_CHAIN.items()},
}


@pytest.mark.parametrize(("arm", "name", "pattern", "new", "words"), WRONG.values(), ids=WRONG)
def test_what_is_wrong_is_named_with_its_place(tmp_path, arm, name, pattern, new, words):
    folder = copy_arm(tmp_path, arm)
    swap(pattern, new)(folder / name)
    line = refused(load_arm, folder)
    assert all(word in line for word in words), line


def test_a_body_outside_the_chain_is_no_link(tmp_path):
    folder = copy_arm(tmp_path)
    hinge = re.search(HINGE, (folder / "rigid.xml").read_text("utf-8"))[0]
    swap(r'(?<=<body name=")link_2(?=")', "between")(folder / "rigid.xml")
    swap("<worldbody>", f'<worldbody><body name="link_2">{hinge}</body>')(folder / "rigid.xml")
    assert "'link_2'>: expected as a direct child of body 'link_1'" in refused(load_arm, folder)


# rigid.xml by itself: what it holds passes the allow-list or is refused

BOMB = '<!DOCTYPE m [<!ENTITY a "b"><!ENTITY c "&a;&a;">]><mujoco model="&c;"/>'
UTF_16 = ('<?xml version="1.0" encoding="utf-16"?>' + BOMB).encode("utf-16")
LATIN = '<?xml version="1.0" encoding="latin-1"?><!-- Stahlträger --><mujoco/>'.encode("latin-1")
OUTSIDE = "expected a file inside the arm's folder"


def mesh(file, compiler=""):
    body = '<worldbody><body name="a"><inertial pos="0 0 0" mass="1"/></body></worldbody>'
    return f'<mujoco>{compiler}<asset><mesh name="m" file="{file}"/></asset>{body}</mujoco>'


def inside(element):
    return f"<mujoco>{element}</mujoco>"


TEXTS = {
    "nothing": ("", "not well-formed XML: .*line 1"),
    "another root": ("<robot/>", "expected <mujoco> at the top, got <robot>"),
    "entities": (BOMB, "document types and entities are not allowed"),
    "entities that hide in another encoding": (UTF_16, "expected UTF-8"),
    "bytes of a declared encoding": (LATIN, "expected UTF-8"),
    "a namespace of two lines": ('<mujoco><n:body xmlns:n="a&#10;b"/></mujoco>', "<{a b}body>: not allowed"),
    **{
        f"{n} nested bodies": (
            inside("<body>" * n + "</body>" * n),
            f"at most {MAX_NESTING} nested elements",
        )
        for n in (MAX_NESTING + 1, 20_000)
    },
    "4 MB": (inside(f"<!--{'x' * 4_000_000}-->"), "expected at most 4000000 bytes, got 4000"),
    "a zero mass": (inside('<inertial pos="0 0 0" mass="0"/>'), "mass: expected more than 0 kg, got 0.0"),
    "a mass in words": (inside('<inertial mass="heavy"/>'), r"mass: expected 1 number\(s\) up to 1e\+06"),
    "a mass of 1e300 kg": (inside('<inertial mass="1e300"/>'), r"mass: expected 1 number\(s\) up to 1e\+06"),
    "three of a quaternion's four": (inside('<body quat="1 0 0"/>'), r"<body>: quat: expected 4 number\(s\)"),
    "a weightless body": (inside('<body gravcomp="1"/>'), "<body>: 'gravcomp' is not allowed; allowed are"),
    "a spring": (inside('<joint stiffness="1"/>'), "<joint>: 'stiffness' is not allowed; allowed are"),
    "a default joint": (inside("<default><joint/></default>"), "<default>: joint defaults are not allowed"),
    "gravity on the moon": (inside('<option gravity="0 0 -1.62"/>'), "gravity: expected '0 0 -9.81'"),
    "gravity switched off": (
        inside('<option><flag gravity="disable"/></option>'),
        "'gravity' is not allowed",
    ),
    "a number that is none": (inside('<geom size="-NaN"/>'), "<geom>: size: expected numbers, got '-NaN'"),
    "angles in gon": (inside('<compiler angle="gon"/>'), "angle: expected 'degree' or 'radian', got 'gon'"),
    **{
        f"a mesh at {file}": (mesh(file), f"<mesh name='m'>: file: {OUTSIDE}")
        for file in ("/etc/passwd", "meshes/../../secret.stl", "../armada/a.stl", "link.stl")
    },
    "meshes elsewhere": (mesh("a.stl", '<compiler meshdir="/etc"/>'), f"<compiler>: meshdir: {OUTSIDE}"),
    "meshes above": (mesh("a.stl", '<compiler meshdir="meshes/../.."/>'), f"<compiler>: meshdir: {OUTSIDE}"),
    "a deeper link": (mesh("link.stl", '<compiler meshdir="meshes"/>'), f"file: {OUTSIDE}"),
}


@pytest.fixture
def rigid(tmp_path):
    """Writes rigid.xml into an arm's folder with meshes, and links that lead out of it."""
    (tmp_path / "arm" / "meshes").mkdir(parents=True)
    for folder in (tmp_path / "arm", tmp_path / "arm" / "meshes"):
        (folder / "link.stl").symlink_to("/etc/passwd")
        (folder / "a.stl").touch()

    def write(text):
        file = tmp_path / "arm" / "rigid.xml"
        file.write_bytes(text if isinstance(text, bytes) else text.encode())
        return file

    return write


@pytest.mark.parametrize(("text", "said"), TEXTS.values(), ids=TEXTS)
def test_a_text_that_is_no_arm_is_refused(rigid, text, said):
    assert re.search(said, refused(read_mjcf, rigid(text)))


def test_meshes_inside_the_folder_are_accepted_and_a_link_to_itself_leads_nowhere(rigid):
    """As are elements as deep in one another as may be."""
    read_mjcf(rigid(inside("<body>" * MAX_NESTING + "</body>" * MAX_NESTING)))
    file = rigid(mesh("a.stl", '<compiler meshdir="meshes"/>'))
    assert read_mjcf(file).find("asset/mesh") is not None
    (file.parent / "loop.stl").symlink_to("loop.stl")
    assert read_mjcf(rigid(mesh("loop.stl"))).find("asset/mesh") is not None


def test_a_folder_that_hides_a_built_in_arm_is_named(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "kr500_l480").mkdir()
    assert "hides the built-in arm of its name: move it away" in refused(find_arm, "kr500_l480")


# A compensator


def test_a_compensator_is_read_and_an_arm_needs_none():
    own = load_arm(MODELS / "kr500_l480").compensator
    np.testing.assert_array_equal(own.foot, [-0.49, 0.3, -0.26])
    np.testing.assert_array_equal(own.head, [-0.06, 0.3, 0.26])
    assert (own.rate, own.rest_length) == (6.2e4, 0.115)
    assert load_arm(MODELS / "arm_6r").compensator is None


def test_a_compensator_needs_a_hinge_between_link_1_and_link_2(tmp_path):
    folder = copy_arm(tmp_path, "single_link")
    text = (MODELS / "kr500_l480" / "elastic.toml").read_text()
    table = text[text.index("[compensator]") : text.index("[[link]]")]
    swap(r"\[\[link\]\]", table + "[[link]]")(folder / "elastic.toml")
    assert "expected a hinge between link 1 and link 2" in refused(load_arm, folder)
