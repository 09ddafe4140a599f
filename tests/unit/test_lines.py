"""Messages about a person's files name line and column."""

import xml.etree.ElementTree as ET

import pytest

from testbench.arm.lines import toml_place, xml_place

TOML = """\
format = 1
payload = { value = 3, unit = "kg" }
[[link]]
name = "base"
tube.length = { value = 0.7, unit = "m" }
  [link.frame]
  x = 1
[[link]]
name = "arm"  # [[link]] in a comment
tube.length = { unit = "m", value = 0.7 }
"""


@pytest.mark.parametrize(
    ("keys", "place"),
    [
        (("format",), "line 1, column 1, format"),
        (("payload", "unit"), "line 2, column 24, payload.unit"),
        (("link", 0, "name"), "line 4, column 1, link.0.name"),
        (("link", 0, "tube", "length", "value"), "line 5, column 17, link.0.tube.length.value"),
        (("link", 0, "frame", "x"), "line 7, column 3, link.0.frame.x"),
        (("link", 1, "name"), "line 9, column 1, link.1.name"),
        (("link", 1, "tube", "length", "value"), "line 10, column 29, link.1.tube.length.value"),
        (("link", 1, "axis"), "line 8, column 3, link.1.axis"),
        (("joint",), "joint"),
    ],
)
def test_a_value_in_toml_has_its_line_and_column(tmp_path, keys, place):
    (tmp_path / "a.toml").write_text(TOML)
    assert toml_place(tmp_path / "a.toml", keys) == place


def test_an_element_has_its_line_and_column(tmp_path):
    file = tmp_path / "a.xml"
    file.write_text("<mujoco>\n <body/>\n  <body name='b'/>\n</mujoco>")
    first, second = ET.fromstring(file.read_text())
    assert xml_place(file, first) == "line 2, column 2, <body>"
    assert xml_place(file, second) == "line 3, column 3, <body name='b'>"
    file.unlink()
    assert xml_place(file, second) == "<body name='b'>"
