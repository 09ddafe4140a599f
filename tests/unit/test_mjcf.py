"""A stranger's MJCF passes the allow-list or is refused in one line, whatever it holds."""

import math
import re
from pathlib import Path

import pytest

from testbench.arm.mjcf import angle_unit, find_body, numbers, read_mjcf
from testbench.errors import InputError

MODELS = Path(__file__).parents[2] / "models"
BODY = '<worldbody><body name="a"><inertial pos="0 0 0" mass="1"/></body></worldbody>'


def write(tmp_path: Path, text: str | bytes) -> Path:
    folder = tmp_path / "arm"
    folder.mkdir(exist_ok=True)
    file = folder / "rigid.xml"
    file.write_bytes(text if isinstance(text, bytes) else text.encode())
    return file


def refusal(file: Path) -> str:
    """What read_mjcf says of a wrong file."""
    with pytest.raises(InputError) as info:
        read_mjcf(file)
    message = str(info.value)
    assert message.startswith(f"{file}: ")
    assert len(message.splitlines()) == 1
    assert len(message) <= 2000
    return message


@pytest.mark.parametrize("name", ["arm_6r", "kr500_l480", "single_link", "ur10"])
def test_own_models_pass_the_allow_list(name: str) -> None:
    assert read_mjcf(MODELS / name / "rigid.xml").tag == "mujoco"


BOMB = '<!DOCTYPE m [<!ENTITY a "b"><!ENTITY c "&a;&a;">]><mujoco model="&c;"/>'
UTF_16 = ('<?xml version="1.0" encoding="utf-16"?>' + BOMB).encode("utf-16")
LATIN = '<?xml version="1.0" encoding="latin-1"?><!-- Stahlträger --><mujoco/>'.encode("latin-1")
TEXTS: dict[str, tuple[str | bytes, str]] = {
    "nothing": ("", "not well-formed XML: .*line 1"),
    "an end without a beginning": ("<mujoco></worldbody>", "not well-formed XML: .*line 1"),
    "another root": ("<robot/>", "expected <mujoco> at the top, got <robot>"),
    "entities": (BOMB, "document types and entities are not allowed"),
    "entities that hide in another encoding": (UTF_16, "expected UTF-8"),
    "bytes of a declared encoding": (LATIN, "expected UTF-8"),
    "a namespace of two lines": ('<mujoco><n:body xmlns:n="a&#10;b"/></mujoco>', "<{a b}body>: not allowed"),
    **{
        f"{n} nested bodies": (
            f"<mujoco>{'<body>' * n}{'</body>' * n}</mujoco>",
            "at most 64 nested elements",
        )
        for n in (70, 200_000)
    },
    "4 MB": (f"<mujoco><!--{'x' * 4_000_000}--></mujoco>", "expected at most 4000000 bytes, got 4000"),
}


@pytest.mark.parametrize(("text", "said"), TEXTS.values(), ids=TEXTS)
def test_a_text_that_is_no_arm_is_refused(tmp_path: Path, text: str | bytes, said: str) -> None:
    assert re.search(said, refusal(write(tmp_path, text)))


@pytest.mark.parametrize("tag", ["include", "replicate", "plugin"])
@pytest.mark.parametrize(
    "place", ["<mujoco>{}</mujoco>", "<mujoco><worldbody><body>{}</body></worldbody></mujoco>"]
)
def test_elements_that_an_arm_may_not_hold_are_named(tmp_path: Path, tag: str, place: str) -> None:
    message = refusal(write(tmp_path, place.format(f'<{tag} file="/etc/passwd" count="1000000000"/>')))
    assert f"<{tag}>: not allowed in an arm; allowed are ['asset', 'body'" in message


def test_missing_file_and_folder_are_refused(tmp_path: Path) -> None:
    assert "No such file" in refusal(tmp_path / "rigid.xml")
    assert "expected a file, got a folder" in refusal(tmp_path)
    assert "File name too long" in refusal(tmp_path / ("x" * 300))


@pytest.mark.parametrize("number", ["nan", "-inf", "1e999"])
@pytest.mark.parametrize("element", ['<geom name="g" size="{} 1"/>', '<body name="g" pos="0 {} 0"/>'])
def test_numbers_that_are_not_finite_are_refused(tmp_path: Path, number: str, element: str) -> None:
    text = f"<mujoco><worldbody>{element.format(number)}</worldbody></mujoco>"
    message = refusal(write(tmp_path, text))
    assert "name='g'>" in message
    assert "expected finite numbers" in message
    assert number in message


WRONG = {
    "a zero mass": ('<inertial pos="0 0 0" mass="0"/>', "<inertial>: mass: expected more than 0 kg, got 0.0"),
    "a mass in words": ('<inertial pos="0 0 0" mass="heavy"/>', "mass: expected finite numbers up to 1e+06"),
    "a mass beyond any arm": (
        '<inertial pos="0 0 0" mass="1e300"/>',
        "mass: expected finite numbers up to 1e+06",
    ),
    "a body turned by three of four": ('<body quat="1 0 0"/>', "<body>: quat: expected 4 number(s)"),
    "a weightless body": ('<body gravcomp="1"/>', "<body>: 'gravcomp' is not allowed; allowed are"),
    "a spring in the rigid arm": (
        '<joint stiffness="1"/>',
        "<joint>: 'stiffness' is not allowed; allowed are",
    ),
    "a default joint": ("<default><joint/></default>", "<default>: no defaults for joints"),
    "gravity on the moon": ('<option gravity="0 0 -1.62"/>', "<option>: gravity: expected '0 0 -9.81'"),
    "angles in gon": (
        '<compiler angle="gon"/>',
        "<compiler>: angle: expected 'degree' or 'radian', got 'gon'",
    ),
}


@pytest.mark.parametrize(("element", "expected"), WRONG.values(), ids=WRONG.keys())
def test_wrong_attribute_names_the_element_and_what_was_expected(
    tmp_path: Path, element: str, expected: str
) -> None:
    assert expected in refusal(write(tmp_path, f"<mujoco>{element}</mujoco>"))


def mesh(file: str, compiler: str = "") -> str:
    return f'<mujoco>{compiler}<asset><mesh name="m" file="{file}"/></asset>{BODY}</mujoco>'


def test_mesh_inside_the_folder_is_accepted(tmp_path: Path) -> None:
    file = write(tmp_path, mesh("a.stl", '<compiler meshdir="meshes"/>'))
    (file.parent / "meshes").mkdir()
    (file.parent / "meshes" / "a.stl").touch()
    assert read_mjcf(file).find("asset/mesh") is not None


OUTSIDE = "expected a file inside the arm's folder"


@pytest.mark.parametrize(
    ("name", "meshdir", "said"),
    [
        ("/etc/passwd", "", f"<mesh name='m'>: file: {OUTSIDE}"),
        ("meshes/../../secret.stl", "", f"<mesh name='m'>: file: {OUTSIDE}"),
        ("../armada/a.stl", "", f"<mesh name='m'>: file: {OUTSIDE}"),
        ("a.stl", "/etc", f"<compiler>: meshdir: {OUTSIDE}"),
        ("a.stl", "meshes/../..", f"<compiler>: meshdir: {OUTSIDE}"),
        ("link.stl", "", f"file: {OUTSIDE}"),
        ("link.stl", "meshes", f"file: {OUTSIDE}"),
    ],
)
def test_what_leads_out_of_the_folder_is_refused(tmp_path: Path, name: str, meshdir: str, said: str) -> None:
    """Links too."""
    file = write(tmp_path, mesh(name, f'<compiler meshdir="{meshdir}"/>' if meshdir else ""))
    (file.parent / "meshes").mkdir()
    for folder in (file.parent, file.parent / "meshes"):
        (folder / "link.stl").symlink_to("/etc/passwd")
    assert said in refusal(file)


def test_symbolic_link_to_itself_does_not_crash_the_reader(tmp_path: Path) -> None:
    file = write(tmp_path, mesh("loop.stl"))
    (file.parent / "loop.stl").symlink_to("loop.stl")
    assert read_mjcf(file).find("asset/mesh") is not None  # it leads nowhere, so not out of the folder


@pytest.mark.parametrize(
    ("compiler", "unit"),
    [
        ("", math.pi / 180),
        ('<compiler angle="degree"/>', math.pi / 180),
        ('<compiler angle="radian"/>', 1.0),
        ('<compiler angle="radian"/><compiler meshdir="."/>', 1.0),
    ],
)
def test_angles_are_degrees_unless_the_compiler_says_radian(
    tmp_path: Path, compiler: str, unit: float
) -> None:
    assert angle_unit(read_mjcf(write(tmp_path, f"<mujoco>{compiler}</mujoco>"))) == unit


def test_numbers_are_read_as_written(tmp_path: Path) -> None:
    file = write(tmp_path, '<mujoco><worldbody><body pos=" 1 -2.5e-3\n7 "/></worldbody></mujoco>')
    body = next(read_mjcf(file).iter("body"))
    assert numbers(file, body, "pos", 3) == [1.0, -2.5e-3, 7.0]


def test_body_is_found_by_its_only_name(tmp_path: Path) -> None:
    file = write(
        tmp_path, '<mujoco><worldbody><body name="a"/><body name="b"/><body name="b"/></worldbody></mujoco>'
    )
    root = read_mjcf(file)
    assert find_body(file, root, "a").get("name") == "a"
    with pytest.raises(InputError, match=r"no body 'c'; bodies are \['a', 'b', 'b'\]"):
        find_body(file, root, "c")
    with pytest.raises(InputError, match=r"2 bodies 'b'"):
        find_body(file, root, "b")
