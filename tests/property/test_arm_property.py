"""Whatever rigid.xml and elastic.toml hold: a sound arm, or one line of InputError; nothing else escapes."""

import re
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from refused import one_line

from testbench.arm.folder import load_arm
from testbench.errors import InputError

MODELS = Path(__file__).parents[2] / "models"
FUZZ = settings(
    deadline=None,
    derandomize=True,
    database=None,
    max_examples=100,
    suppress_health_check=[HealthCheck.function_scoped_fixture],  # every example rewrites the whole folder
)
TOML = {name: (MODELS / name / "elastic.toml").read_bytes() for name in ("arm_6r", "single_link")}
XML = {name: (MODELS / name / "rigid.xml").read_bytes() for name in ("arm_6r", "single_link")}

NUMBERS = [
    *b"nan -inf inf 1e999 1e-320 1e200 -1 0 -0.0 1 1_0 1e . 0b1 1979-05-27 12:00:00 true".split(),
    *(b"9" * 400, b"9" * 5000, b"0x" + b"f" * 9000, b"1 2 3", b""),
]
MARKS = [
    *(b"\0", b"\xff", b"\xc3", b"\n", b"\r", b"\t", b" ", "\ufeff".encode(), "é".encode(), "\u2028".encode()),
    *rb"""\ \u0000 &#10; &#0; &a; & ' " ''' # = . , [ ] [[ ]] { } {} [] < > /> </body> <!-- -->""".split(),
    *(b'"""', b"<![CDATA[", b"]]>", b"<?x?>", b"[" * 3000, b"{a=" * 3000, b"a." * 3000, b"x" * 5000),
    *(b"<!DOCTYPE m>", b"<include file='/etc/passwd'/>", b"<replicate count='999'/>", b"<body/>"),
    *(b"<body name='link_1'/>", b"<joint/>", b"<default><joint/></default>", b"<body>" * 100, b"xmlns='a'"),
    *(b"<compiler angle='degree'/>", b"<compiler meshdir='..'/>", b"<mesh file='../x.stl'/>"),
    *(b"<mesh file='" + b"x" * 5000 + b"'/>", b"link_1", b"joint_1", b"tool", b"probe", b"name", b"tube"),
    *(b"compliance", b"m", b"/", b"../..", b"link", b"[1, [2.0, 'a']]", b"{value = 1, a = {unit = true}}"),
]


PATTERNS = [rb"[-+.\d][-+.\de]*", rb"\w+", rb'"[^"\n]*"', rb"<[^>]*>", rb"[^\n]*\n", rb"[\s\S]"]


@st.composite
def mutated(draw: st.DrawFn, files: dict[str, bytes]) -> tuple[str, bytes]:
    """A model's name, and its file with up to three tokens, bytes or lines replaced, doubled or dropped."""
    name = draw(st.sampled_from(sorted(files)))
    content = files[name]
    for _ in range(draw(st.integers(1, 3))):
        pattern = draw(st.sampled_from(PATTERNS))
        spans = [m.span() for m in re.finditer(pattern, content)]
        if not spans:
            continue
        a, b = draw(st.sampled_from(spans))
        c, d = draw(st.sampled_from(spans))
        own = st.sampled_from([b"", content[a:b] * 2, content[c:d]])
        content = content[:a] + draw(st.one_of(own, st.sampled_from(NUMBERS + MARKS))) + content[b:]
    return name, content


@pytest.fixture
def folder() -> Iterator[Path]:
    with tempfile.TemporaryDirectory() as parent:
        yield Path(parent) / "arm"


def check_loading(folder: Path, name: str, content: bytes, file: str) -> None:
    """Either an arm in which everything is sound, or an InputError of one line."""
    folder.mkdir(exist_ok=True)
    for other in ("rigid.xml", "elastic.toml"):
        shutil.copyfile(MODELS / name / other, folder / other)
    (folder / file).write_bytes(content)
    try:
        arm = load_arm(folder)
    except InputError as err:
        one_line(err, folder)
        return
    assert len(arm.links) == arm.n_joints + 1
    assert len(set(arm.markers)) == len(arm.markers) >= 1
    lower, upper = arm.limits
    assert np.isfinite(arm.limits).all()
    assert (lower < upper).all()
    for link in arm.links:
        np.testing.assert_allclose(link.frame.T @ link.frame, np.eye(3), rtol=0, atol=1e-14)
        d = np.sqrt(np.diag(link.compliance))
        assert np.linalg.eigvalsh(link.compliance / np.outer(d, d))[0] > 0
        assert np.isfinite(np.linalg.inv(link.compliance)).all()
    assert all(np.isfinite(1 / joint.compliance) for joint in arm.joints)


BYTES = st.one_of(st.binary(max_size=200), st.text(max_size=200).map(lambda s: s.encode("utf-8", "replace")))


@pytest.mark.parametrize(("file", "files"), [("elastic.toml", TOML), ("rigid.xml", XML)])
@FUZZ
@given(data=st.data())
def test_nothing_in_a_file_crashes_the_reader(folder, file, files, data):
    check_loading(folder, *data.draw(mutated(files)), file)
    own = data.draw(BYTES)
    for content in (own, b"<mujoco>" + own + b"</mujoco>"):
        check_loading(folder, "single_link", content, file)
