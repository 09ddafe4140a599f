"""Origins of a robot's own URDF exchanged in its text: nothing else of it changes."""

import re
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from testbench.errors import InputError
from testbench.files.export_own import BEGINS, STAMP, origin_of, rpy_of, with_origins

TEXT = (
    '<?xml version="1.0"?>\r\n<!-- mine -->\r\n<robot name="r" xmlns:xacro="x">\r\n'
    "  <link name='l0'><visual><origin xyz=\"9 9 9\"/></visual></link>\r\n"
    '  <joint name="a > b" type="revolute"><parent link="l0"/>\t<child link="ü"/>\r\n'
    "    <origin rpy='0 0 0'\r\n      xyz='1 2 3' ></origin><!-- kept --><axis xyz=\"0 0 1\"/></joint>\r\n"
    '  <transmission><joint name="a > b"><origin xyz="8 8 8"/></joint></transmission>\r\n'
    '  <joint type="fixed" name="none"><parent link="ü"/><child link="tip"/></joint>\r\n'
    '  <joint name="other" type="fixed"><origin xyz="7 7 7"/></joint></robot>\r\n<!-- end -->'
)


@pytest.mark.parametrize("pitch", [0.3, np.pi / 2, -np.pi / 2, np.pi / 2 - 1e-9, np.pi / 2 + 1e-6, 3.0])
def test_roll_pitch_yaw_give_back_any_rotation(pitch):
    """Near a pitch of 90 degrees an arc sine would lose half of the digits."""
    for roll, yaw in np.random.default_rng(1).uniform(-np.pi, np.pi, (50, 2)):
        R = Rotation.from_euler("xyz", [roll, pitch, yaw]).as_matrix()
        np.testing.assert_allclose(Rotation.from_euler("xyz", rpy_of(R)).as_matrix(), R, atol=4e-15)


def test_only_the_origins_that_are_asked_for_change():
    pose = np.eye(4)
    pose[:3, 3] = -1e-14, 0.1234567890123, -2
    new = with_origins(Path("r.urdf"), TEXT, {"a > b": pose, "none": np.eye(4)})
    said = '<origin xyz="0 0.123456789012 -2" rpy="0 0 0"'
    expected = TEXT.replace("<origin rpy='0 0 0'\r\n      xyz='1 2 3' >", f"{said}>")
    expected = expected.replace('name="none">', 'name="none"><origin xyz="0 0 0" rpy="0 0 0"/>')
    assert new.replace(STAMP, "").replace("\n", "").replace("\r", "") == expected.replace("\r\n", "")
    assert new.count("\r\n") == TEXT.count("\r\n") - 2  # behind the declaration, and inside of the old tag
    with pytest.raises(InputError, match="no joint 'x'"):
        with_origins(Path("r.urdf"), TEXT, {"x": pose})
    assert ET.fromstring(new).find("joint").find("origin").attrib == origin_of(pose)


@pytest.mark.parametrize("head", ["", '<?xml version="1.0" encoding="UTF-8"?>', "\n\n"])
def test_what_we_wrote_is_known_by_its_beginning(head):
    text = with_origins(Path("r"), f"{head}<robot name='r'><joint name='j'/></robot>", {})
    assert re.match(BEGINS, text.encode())
    assert ET.fromstring(text).tag == "robot"
    assert not re.match(BEGINS, f"{head}<robot/>".encode())
