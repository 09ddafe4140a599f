"""An arm's folder is read exactly, or refused in one line: which file, where, and what was expected."""

import re
import shutil
from pathlib import Path

import numpy as np
import pytest

from testbench.arm.folder import Arm, load_arm
from testbench.errors import InputError, shown

MODELS = Path(__file__).parents[2] / "models"
LENGTH, DIAMETER = r"(?<=tube\.length = \{ value = )[^,]+", r"(?<=outer_diameter = \{ value = )[^,]+"
INNER, MODULUS = r"(?<=inner_diameter = \{ value = )[^,]+", r"(?<=youngs_modulus = \{ value = )[^,]+"
POISSON, AXIS = r"(?<=poissons_ratio = \{ value = )[^,]+", r"(?<=axis = )\[.*?\]"
PAYLOAD = r"(?<=payload = \{ value = )[^,]+"
JOINT = r"(?<=\ncompliance = \{ value = )[^,]+"


def copy_arm(tmp_path: Path, name: str = "arm_6r") -> Path:
    """A copy of a model's folder, to be broken."""
    return Path(shutil.copytree(MODELS / name, tmp_path / name))


def change(file: Path, pattern: str, new: str) -> None:
    """Replace the first match of a pattern, which must be there."""
    text = file.read_text("utf-8")
    changed = re.sub(pattern, lambda _: new, text, count=1)
    assert changed != text, f"{pattern} changes nothing in {file.name}"
    file.write_text(changed, "utf-8")


def refusal(folder: Path) -> str:
    """What load_arm says of a wrong folder."""
    with pytest.raises(InputError) as info:
        load_arm(folder)
    message = str(info.value)
    assert message.startswith(shown(str(folder)))
    assert len(message.splitlines()) == 1
    assert len(message) <= 2000
    return message


def toml_refusal(tmp_path: Path, pattern: str, new: str) -> str:
    folder = copy_arm(tmp_path)
    change(folder / "elastic.toml", pattern, new)
    return refusal(folder)


def xml_refusal(tmp_path: Path, pattern: str, new: str) -> str:
    folder = copy_arm(tmp_path)
    change(folder / "rigid.xml", pattern, new)
    return refusal(folder)


def matrix_arm(tmp_path: Path, C: object) -> Path:
    """The single link with another compliance."""
    folder = copy_arm(tmp_path, "single_link")
    rows = C.tolist() if isinstance(C, np.ndarray) else C
    change(folder / "elastic.toml", r"value = \[[\s\S]*\n\]", f"value = {rows}")
    return folder


def eq_21() -> np.ndarray:
    return load_arm(MODELS / "single_link").links[0].compliance.copy()


# What is right


@pytest.mark.parametrize(
    ("name", "links", "joints"), [("arm_6r", 7, 6), ("kr500_l480", 7, 6), ("single_link", 1, 0)]
)
def test_every_model_loads_with_one_link_more_than_joints(name: str, links: int, joints: int) -> None:
    arm = load_arm(MODELS / name)
    assert (len(arm.links), arm.n_joints) == (links, joints)
    assert arm.n_theta == 6 * links + joints
    assert [x.name for x in arm.links] == [f"link_{i}" for i in range(links)]
    assert [x.name for x in arm.joints] == [f"joint_{i + 1}" for i in range(joints)]
    assert arm.limits.shape == (2, joints)
    for link in arm.links:
        np.testing.assert_allclose(link.frame.T @ link.frame, np.eye(3), rtol=0, atol=1e-15)
        assert np.linalg.det(link.frame) > 0


def test_aggregated_compliance_is_block_diagonal_links_first() -> None:
    arm = load_arm(MODELS / "arm_6r")
    C = arm.C_theta
    assert C.shape == (48, 48)
    for i, link in enumerate(arm.links):
        np.testing.assert_array_equal(C[6 * i : 6 * i + 6, 6 * i : 6 * i + 6], link.compliance)
        C[6 * i : 6 * i + 6, 6 * i : 6 * i + 6] = 0
    np.testing.assert_array_equal(np.diag(C)[42:], [j.compliance for j in arm.joints])
    np.testing.assert_array_equal(C - np.diag(np.diag(C)), 0)


def test_single_link_has_the_compliance_of_eq_21_to_the_digit() -> None:
    C = eq_21()
    np.testing.assert_array_equal(np.diag(C), [4.50e-8, 8.01e-5, 3.64e-5, 3.76e-3, 1.09e-3, 2.65e-3])
    assert (C[1, 5], C[2, 4]) == (3.98e-4, -1.71e-4)


def test_an_integer_is_a_fine_number(tmp_path: Path) -> None:
    folder = copy_arm(tmp_path)
    change(folder / "elastic.toml", LENGTH, "2.0")
    change(folder / "elastic.toml", AXIS, "[ 0.0, 0.0, 1.0 ]")
    with_floats = load_arm(folder)
    change(folder / "elastic.toml", LENGTH, "2")
    change(folder / "elastic.toml", AXIS, "[0, 0, 1]")
    same(load_arm(folder), with_floats)


@pytest.mark.parametrize("compiler", ['<compiler angle="degree"/>', "<compiler/>", ""])
def test_limits_in_degrees_become_radians(tmp_path: Path, compiler: str) -> None:
    folder = copy_arm(tmp_path)
    change(folder / "rigid.xml", r"<compiler .*?/>", compiler)
    change(folder / "rigid.xml", r'(?<=name="joint_2")(.*?)range=".*?"', ' axis="0 1 0" range="-90 45"')
    arm = load_arm(folder)
    np.testing.assert_allclose(arm.limits[:, 1], [-np.pi / 2, np.pi / 4], rtol=1e-15)


def test_a_beam_axis_written_to_eight_digits_becomes_an_exact_frame(tmp_path: Path) -> None:
    folder = copy_arm(tmp_path)
    change(folder / "elastic.toml", AXIS, "[0.70710678, 0.0, 0.70710678]")
    frame = load_arm(folder).links[0].frame
    np.testing.assert_allclose(frame.T @ frame, np.eye(3), rtol=0, atol=1e-15)
    np.testing.assert_allclose(frame[:, 0], [np.sqrt(0.5), 0, np.sqrt(0.5)], rtol=0, atol=1e-9)


def test_a_byte_order_mark_is_no_part_of_the_files(tmp_path: Path) -> None:
    folder = copy_arm(tmp_path)
    for file in (folder / "elastic.toml", folder / "rigid.xml"):
        file.write_bytes(b"\xef\xbb\xbf" + file.read_bytes())
    same(load_arm(folder), load_arm(MODELS / "arm_6r"))


def same(a: Arm, b: Arm) -> None:
    np.testing.assert_array_equal(a.C_theta, b.C_theta)
    np.testing.assert_array_equal(a.limits, b.limits)
    np.testing.assert_array_equal([x.frame for x in a.links], [x.frame for x in b.links])
    assert (a.tool, a.load, a.markers) == (b.tool, b.load, b.markers)


def test_a_rounded_symmetric_compliance_is_made_symmetric(tmp_path: Path) -> None:
    C = eq_21()
    C[1, 5] *= 1 + 1e-12
    read = load_arm(matrix_arm(tmp_path, C)).links[0].compliance
    np.testing.assert_array_equal(read, read.T)


# The folder


def test_what_is_no_folder_of_an_arm_is_named(tmp_path: Path) -> None:
    folder = copy_arm(tmp_path)
    for path in (tmp_path / "no_such_arm", tmp_path / "nul\0byte"):
        assert "expected a folder with rigid.xml and elastic.toml" in refusal(path)
    assert "expected a folder" in refusal(folder / "rigid.xml")
    (folder / "rigid.xml").write_bytes(b"")
    assert "rigid.xml" in refusal(folder)
    (folder / "elastic.toml").unlink()
    assert re.search(r"elastic\.toml.*No such file", refusal(folder))


@pytest.mark.parametrize("name", ["rigid.xml", "elastic.toml"])
def test_folder_or_device_in_place_of_a_file_is_refused(tmp_path: Path, name: str) -> None:
    folder = copy_arm(tmp_path)
    (folder / name).unlink()
    (folder / name).mkdir()
    assert "expected a file, got a folder or a device" in refusal(folder)
    (folder / name).rmdir()
    (folder / name).symlink_to("/dev/zero")  # endless
    assert "expected a file, got a folder or a device" in refusal(folder)


@pytest.mark.parametrize("name", ["rigid.xml", "elastic.toml"])
def test_bytes_that_are_not_utf8_are_located(tmp_path: Path, name: str) -> None:
    folder = copy_arm(tmp_path)
    file = folder / name
    file.write_bytes(file.read_bytes()[:20] + "Stahlträger".encode("latin-1"))
    message = refusal(folder)
    assert name in message
    assert "byte 28: expected UTF-8" in message


# elastic.toml as a document


def test_malformed_toml_is_located_by_line_and_column(tmp_path: Path) -> None:
    message = toml_refusal(tmp_path, r"format = 1", "format = = 1")
    assert "elastic.toml: not TOML" in message
    assert re.search(r"line \d+, column \d+", message)


def test_garbage_is_not_repeated_to_its_owner(tmp_path: Path) -> None:
    message = toml_refusal(tmp_path, r"\A", f'"{"x" * 50_000}" = 1\n')
    assert message.endswith("...")


# elastic.toml: keys and values

WRONG_TOML = {
    "too large a file": (r"\A", "#" * 100_000 + "\n", ["expected at most 100000 bytes"]),
    "lists without end": (r"\A", f"x = {'[' * 40_000}\n", ["elastic.toml: not TOML"]),
    "tables without end": (r"\A", f"x = {'{a=' * 20_000}\n", ["elastic.toml: not TOML"]),
    "deep lists": (r"\A", f"x = {'[' * 200}{']' * 200}\n", ["elastic.toml: line 1, column 1, x: "]),
    "a dotted key without end": (r"\A", f"x{'.x' * 40_000} = 1\n", ["line 1: expected at most 200 dots"]),
    "5000 digits": (LENGTH, "9" * 5000, ["not TOML"]),
    "9000 digits": (LENGTH, "0x" + "f" * 9000, ["length.value: "]),
    "400 digits": (LENGTH, "9" * 400, ["valid number"]),
    "a key of two lines": (r"\A", '"a\\nb" = 1\n', ["a b: Extra"]),
    "a name of two lines": (r'tool = "tool"', 'tool = "to\\nol"', ["tool: "]),
    "an unknown key at the top": (r"\A", "colour = 1\n", ["colour: Extra inputs are not permitted"]),
    "a missing title": (r"title = .*", "", ["title: Field required"]),
    "another format": (r"format = 1", "format = 2", ["format: Input should be 1, got 2"]),
    "a string for a number": (LENGTH, '"0.7"', ["link.0.tube.length.value", "valid number", "got '0.7'"]),
    "a boolean for a number": (LENGTH, "true", ["link.0.tube.length.value", "valid number", "got True"]),
    "no markers": (r"markers = .*", "markers = []", ["markers", "at least 1 item"]),
    "NaN": (LENGTH, "nan", ["link.0.tube.length.value", "finite number", "got nan"]),
    "a wrong unit": (r'unit = "m"', 'unit = "mm"', ["link.0.tube.length.unit", "'m'", "got 'mm'"]),
    "a wrong origin": (
        r'"assumed"',
        '"guessed"',
        ["payload.origin", "'published', 'inferred', 'assumed' or 'estimated'"],
    ),
    "a slide's compliance for a hinge": (
        r'(?<=unit = )"rad/\(N m\)"',
        '"m/N"',
        ["joint (joint_1) compliance.unit: expected rad/(N m) for a hinge, got m/N"],
    ),
    "a payload in tonnes": (PAYLOAD, "0.0001", ["payload: expected 0.001 to 10000 kg, got 0.0001"]),
    "a zero length": (LENGTH, "0.0", ["link.0.tube (link_0)", "length: expected 0.001 to 100 m, got 0.0"]),
    "a tube of 99 m": (LENGTH, "99.0", ["link.0.tube.length (link_0)", "expected at most", "got 99 m"]),
    "a point that is not there": (
        r"markers = .*",
        'markers = ["probe"]\nto_confirm = ["P9"]',
        ["to_confirm", "'P9'"],
    ),
    "an inner diameter above the outer": (INNER, "9.0", ["inner_diameter: expected 0 to below", "got 9.0"]),
    "GPa for Pa": (MODULUS, "70", ["youngs_modulus: expected 1e+06 to 1e+13 Pa, got 70"]),
    "Poisson's ratio of a fluid": (POISSON, "0.5", ["poissons_ratio: expected between -1 and 0.5, got 0.5"]),
    "both a tube and a compliance": (
        r"axis = ",
        'compliance = { value = [], unit = "m/N, rad/(N m)", origin = "assumed" }\naxis = ',
        ["link.0 (link_0)", "expected either a tube or a compliance"],
    ),
    "neither a tube nor a compliance": (
        r"(tube\..*\n)+",
        "\n",
        ["link.0 (link_0)", "expected either a tube or a compliance"],
    ),
    "an axis that is no unit vector": (AXIS, "[0.0, 0.0, 1.001]", ["link.0.axis (link_0)", "unit vectors"]),
    "an axis along the normal": (AXIS, "[0.0, 1.0, 0.0]", ["link.0.axis (link_0)", "at right angles"]),
    "an axis of two numbers": (AXIS, "[0.0, 1.0]", ["link.0.axis", "at least 3 items"]),
    "a zero joint compliance": (
        JOINT,
        "0.0",
        ["joint.0.compliance (joint_1)", "expected 1e-18 to 1000"],
    ),
    "one joint too few": (r"\[\[joint\]\]\n.*\n.*\n", "", ["link: ", "got 7 links and 5 joints"]),
    "a joint named twice": (r'"joint_2"', '"joint_1"', ["joint: expected different names"]),
    "an empty name": (r'tool = "tool"', 'tool = ""', ["tool", "at least 1 character"]),
}


@pytest.mark.parametrize(("pattern", "new", "expected"), WRONG_TOML.values(), ids=WRONG_TOML.keys())
def test_wrong_toml_names_the_place_and_what_was_expected(
    tmp_path: Path, pattern: str, new: str, expected: list[str]
) -> None:
    message = toml_refusal(tmp_path, pattern, new)
    for words in ("elastic.toml: ", *expected):
        assert words in message


# elastic.toml: a compliance in full


def test_asymmetric_compliance_names_the_link_and_both_entries(tmp_path: Path) -> None:
    C = eq_21()
    C[1, 5] = 2.0e-4
    message = refusal(matrix_arm(tmp_path, C))
    assert "link.0.compliance (link_0): compliance: expected a symmetric matrix" in message
    assert "0.0002 at row 2, column 6 against 0.000398 at row 6, column 2" in message


def test_ragged_compliance_is_refused(tmp_path: Path) -> None:
    rows = eq_21().tolist()
    rows[3].pop()
    assert "link.0.compliance (link_0): compliance: expected numbers" in refusal(matrix_arm(tmp_path, rows))


@pytest.mark.parametrize(("entry", "problem"), [('"1e-8"', "valid number"), ("nan", "finite number")])
def test_wrong_entry_of_a_compliance_is_located(tmp_path: Path, entry: str, problem: str) -> None:
    folder = copy_arm(tmp_path, "single_link")
    change(folder / "elastic.toml", r"8\.01e-5", entry)
    message = refusal(folder)
    assert "link.0.compliance.value.1.1: " in message
    assert problem in message


# rigid.xml against elastic.toml

HINGE = r'<joint name="joint_2".*?/>'

WRONG_CHAIN = {
    "a missing body": (r'name="link_2"', 'name="upper_arm"', ["no body 'link_2'; bodies are ['link_0'"]),
    "a missing joint": (HINGE, "", ["<body name='link_2'>", "exactly the joint 'joint_2'", "got []"]),
    "a wrong joint name": (
        r'name="joint_2"',
        'name="a2"',
        ["<body name='link_2'>", "'joint_2'", "got ['a2']"],
    ),
    "a ball joint": (
        r'name="joint_2"',
        'name="joint_2" type="ball"',
        ["'joint_2'>: expected a hinge or a slide, got 'ball'"],
    ),
    "a joint off its body's origin": (r'name="joint_2"', 'name="joint_2" pos="0 0 0.1"', ["expected no pos"]),
    "a missing range": (
        HINGE,
        '<joint name="joint_2" axis="0 1 0"/>',
        ["'joint_2'>", "attribute range of 2"],
    ),
    "an inverted range": (
        HINGE,
        '<joint name="joint_2" axis="0 1 0" range="1 -1"/>',
        ["<joint name='joint_2'>: range: expected lower < upper, got '1 -1'"],
    ),
    "a range too wide to draw from": (
        HINGE,
        '<joint name="joint_2" axis="0 1 0" range="-1e308 1e308"/>',
        ["<joint name='joint_2'>: range: expected finite numbers up to 1e+06"],
    ),
    "a zero axis": (
        HINGE,
        '<joint name="joint_2" axis="0 0 0" range="-1 1"/>',
        ["<joint name='joint_2'>: axis: expected a direction, got zero"],
    ),
    "a joint of the base": (
        r'<body name="link_1"',
        '<joint name="track"/><body name="link_1"',
        ["<joint>: expected the joints ['joint_1'", "no other", "'track'"],
    ),
    "a missing inertial": (
        r'<inertial pos="0.45.*?/>',
        "",
        ["<body name='link_2'>", "expected an <inertial>"],
    ),
    "a missing load point": (r'name="load"', 'name="hook"', ["<body name='tool'>: no load point 'load'"]),
    "a missing marker": (
        r'name="probe"',
        'name="P1"',
        ["<body name='tool'>: no marker 'probe'; bodies are ['load', 'P1']"],
    ),
    "a duplicate marker": (
        r'<body name="load"',
        '<body name="probe"/><body name="load"',
        ["2 bodies 'probe'"],
    ),
}


@pytest.mark.parametrize(("pattern", "new", "expected"), WRONG_CHAIN.values(), ids=WRONG_CHAIN.keys())
def test_wrong_chain_names_the_element_and_what_was_expected(
    tmp_path: Path, pattern: str, new: str, expected: list[str]
) -> None:
    message = xml_refusal(tmp_path, pattern, new)
    for words in ("rigid.xml: ", *expected):
        assert words in message


def test_body_outside_the_chain_is_no_link(tmp_path: Path) -> None:
    folder = copy_arm(tmp_path)
    change(folder / "rigid.xml", r'(?<=<body name=")link_2(?=")', "between")
    change(
        folder / "rigid.xml", r"<worldbody>", '<worldbody><body name="link_2">' + joint_2(folder) + "</body>"
    )
    message = refusal(folder)
    assert "<body name='link_2'>: expected as a direct child of body 'link_1'" in message


def joint_2(folder: Path) -> str:
    found = re.search(HINGE, (folder / "rigid.xml").read_text("utf-8"))
    assert found
    return found[0]


def test_tool_in_the_middle_of_the_chain_is_refused(tmp_path: Path) -> None:
    message = toml_refusal(tmp_path, r'tool = "tool"', 'tool = "link_3"')
    assert "<body name='link_3'>: expected as a direct child of body 'link_6'" in message


@pytest.mark.parametrize(("key", "kind"), [("load", "load point"), ("markers", "marker")])
def test_unknown_point_of_the_toml_lists_what_the_tool_has(tmp_path: Path, key: str, kind: str) -> None:
    value = '["P9"]' if key == "markers" else '"P9"'
    message = toml_refusal(tmp_path, rf"{key} = .*", f"{key} = {value}")
    assert f"no {kind} 'P9'; bodies are ['load', 'probe']" in message
