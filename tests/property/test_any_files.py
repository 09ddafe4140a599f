"""Whatever a file holds: a dataset comes back from any dialect, an arm is sound, or one line says why."""

import re
import shutil
import tempfile
from collections.abc import Callable
from dataclasses import fields
from pathlib import Path
from random import Random
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from refused import one_line

from testbench import load_arm, read_csv, write_csv
from testbench.data.dataset import Dataset, select_runs, split_by_pose
from testbench.errors import InputError
from testbench.files.names import MAX_NUMBERS, MIN_NUMBER
from testbench.files.read_pairs import SIGMA_RANGE

ROOT = Path(__file__).parents[2]
MODELS = ROOT / "models"
ARM = load_arm(MODELS / "kr500_l480")
HEADER = (ROOT / "docs" / "example_dataset.csv").read_text(encoding="utf-8").partition("\n")[0]
LOWER, UPPER = ARM.limits
REPEATABLE = settings(deadline=None, derandomize=True, database=None, max_examples=40)
FUZZ = settings(REPEATABLE, max_examples=80)
LENGTHS = {"m": 1.0, "mm": 1e-3, "um": 1e-6, "in": 0.0254}
ANGLES = {"rad": 1.0, "deg": np.pi / 180, "mrad": 1e-3}
FORCES, MOMENTS = {"N": 1.0, "kN": 1e3}, {"Nm": 1.0, "Nmm": 1e-3}
APART = np.array([0.0, 11.0, 22.0])  #: Three equal coordinates are no place.
STATES = {"before": "Unloaded", "after": "loaded"}
MOST = min(MAX_NUMBERS.values())
ANY = st.floats(-MOST, MOST).filter(lambda x: x == 0 or abs(x) >= MIN_NUMBER)
SOME = st.floats(-5, 5).filter(lambda x: x == 0 or abs(x) >= 1e6 * MIN_NUMBER)
ID = st.integers(-(2**63), 2**63 - 1)


DIALECTS = st.fixed_dictionaries(
    {
        "delimiter": st.sampled_from([",", ";", "\t", "|"]),
        "decimal": st.sampled_from(".,"),
        "encoding": st.sampled_from(["utf-8", "utf-8-sig", "utf-16", "cp1252"]),
        "suffix": st.sampled_from(["_{}", " [{}]", " ({})", " in {}", " / {}"]),  # of a unit in a name
        "length": st.sampled_from(list(LENGTHS)),
        "angle": st.sampled_from(list(ANGLES)),
        "force": st.sampled_from(list(FORCES)),
        "moment": st.sampled_from(list(MOMENTS)),
        "wide": st.booleans(),  # all markers in a row
        "states": st.booleans(),  # a row a state
        "capitals": st.booleans(),
        "title": st.booleans(),  # lines before the header
        "seed": st.integers(0, 999),  # of the order of columns and rows
    }
).map(lambda own: SimpleNamespace(**own))
"""How somebody writes; a comma is no decimal between commas."""


def arms_and_markers(draw: st.DrawFn, runs: int, least: float = 0.0) -> dict[str, object]:
    """Some markers, and joints within their limits or away from them."""
    m, share = draw(st.integers(1, 3)), st.floats(least, 1 - least)
    q = LOWER + (UPPER - LOWER) * draw(arrays(float, (runs, 6), elements=share))
    return {"markers": tuple(draw(st.permutations(ARM.markers))[:m]), "q": q}


@st.composite
def datasets(draw: st.DrawFn) -> Dataset:
    """One to four runs of any numbers that are read, extreme ones too; orientations and set-ups or none."""
    runs = draw(st.integers(1, 4))
    common = arms_and_markers(draw, runs)
    m = len(common["markers"])

    def numbers(*shape: int) -> np.ndarray:
        return draw(arrays(float, shape, elements=ANY))

    def places(*shape: int) -> np.ndarray:
        """Of targets: three equal coordinates are none."""
        found = numbers(*shape, 3)
        equal = (found == found[..., :1]).all(axis=-1)
        found[..., 0] = np.where(equal, found[..., 0] == 0, found[..., 0])
        return found

    def integers(**asked: bool) -> np.ndarray:
        return np.array(draw(st.lists(ID, min_size=runs, max_size=runs, **asked)))

    turned = draw(st.booleans())
    return Dataset(
        **common,
        run_id=integers(unique=True),
        pose_id=integers(),
        wrench=numbers(runs, 6),
        point=numbers(runs, 3),
        before=places(runs, m),
        after=places(runs, m),
        sigma=draw(st.floats(*SIGMA_RANGE)),
        rotation_before=numbers(runs, 3) if turned else None,
        rotation_after=numbers(runs, 3) if turned else None,
        sigma_rotation=draw(st.floats(*SIGMA_RANGE)) if turned else None,
        station=integers() if draw(st.booleans()) else None,
        unloaded_after_load=draw(arrays(bool, runs)) if draw(st.booleans()) else None,
    )


@st.composite
def exported(draw: st.DrawFn) -> Dataset:
    """Runs as an instrument exports them, each in a pose of its own, some targets lost."""
    runs = draw(st.integers(1, 4))
    common = arms_and_markers(draw, runs, 0.1)
    m = len(common["markers"])
    seen = draw(arrays(bool, (runs, m)))
    seen[0] = True
    sigma = draw(st.floats(1e-6, 1e-3))
    wrench, point, before, after = (
        draw(arrays(float, (runs, *shape), elements=SOME)) for shape in ((6,), (3,), (m, 3), (m, 3))
    )
    return Dataset(
        **common,
        run_id=np.arange(runs) + draw(st.integers(-9, 9)),
        pose_id=np.arange(runs) * 2 + 1,
        wrench=wrench,
        point=point,
        before=np.where(seen[..., None], before + APART, 0.0),
        after=np.where(seen[..., None], after + APART, 0.0),
        sigma=sigma,
        precision=None if seen.all() else np.where(seen[..., None, None], np.eye(3) / (2 * sigma**2), 0.0),
    )


def bits(data: Dataset) -> list[object]:
    values = [getattr(data, f.name) for f in fields(Dataset)]
    return [(x.dtype, x.shape, x.tobytes()) if isinstance(x, np.ndarray) else x for x in values]


@REPEATABLE
@given(datasets(), st.data())
def test_any_dataset_survives_its_file_and_a_split_by_poses_bit_by_bit(
    data: Dataset, choose: st.DataObject
) -> None:
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "dataset.csv"
        write_csv(data, ARM, file)
        assert bits(read_csv(file, ARM)) == bits(data)
        assert len(list(Path(folder).iterdir())) == 1
    poses = np.unique(data.pose_id).tolist()
    if chosen := choose.draw(st.sets(st.sampled_from(poses), max_size=len(poses) - 1)):
        mask = np.isin(data.pose_id, sorted(chosen))
        inside, outside = split_by_pose(data, np.array(sorted(chosen)))
        for part, here in ((inside, mask), (outside, ~mask)):
            own = {f.name: getattr(data, f.name) for f in fields(Dataset)}
            own = {name: x[here] if isinstance(x, np.ndarray) else x for name, x in own.items()}
            assert bits(part) == bits(Dataset(**own)) == bits(select_runs(data, here))


def written(data: Dataset, own: SimpleNamespace) -> bytes:
    """The dataset as text."""
    if own.delimiter == ",":
        own.decimal = "."
    random, rows = Random(own.seed), list[dict[str, str]]()

    def name(quantity: str, unit: str) -> str:
        whole = quantity.strip("_") + own.suffix.format(unit)
        return whole.upper() if own.capitals else whole

    def put(row: dict[str, str], quantity: str, unit: str, scale: float, values: np.ndarray) -> None:
        for axis, value in zip("xyz", values, strict=True):
            row[name(f"{quantity}_{axis}", unit)] = repr(float(value) / scale).replace(".", own.decimal)

    for r in range(data.n_runs):
        common = {"run": str(data.run_id[r]), "Pose": str(data.pose_id[r]), "note": "abc", "time": "10:15"}
        for joint, value in zip(ARM.joints, data.q[r], strict=True):
            text = repr(float(value) / ANGLES[own.angle]).replace(".", own.decimal)
            common[name(joint.name, own.angle)] = text
        put(common, "force", own.force, FORCES[own.force], data.wrench[r, :3])
        put(common, "moment", own.moment, MOMENTS[own.moment], data.wrench[r, 3:])
        put(common, "point", own.length, LENGTHS[own.length], data.point[r])
        common[name("sigma", "um")] = repr(data.sigma / 1e-6).replace(".", own.decimal)
        parts: dict[tuple[str, str], dict[str, str]] = {}
        for m, marker in enumerate(data.markers):
            for when in STATES:
                key = ("" if own.wide else marker, STATES[when] if own.states else "")
                what = "_".join(filter(None, (marker if own.wide else "", "" if own.states else when)))
                row = parts.setdefault(key, dict(common))
                put(row, what, own.length, LENGTHS[own.length], getattr(data, when)[r, m])
                row |= {"marker": key[0]} if key[0] else {}
                row |= {"state": key[1]} if key[1] else {}
                if not data.is_measured[r, m]:
                    row |= {name(f"{what}_{axis}", own.length): "" for axis in "xyz"}
        rows += parts.values()
    header = list(rows[0])
    random.shuffle(header)
    lines = [own.delimiter.join(header), *(own.delimiter.join(row[h] for h in header) for row in rows)]
    before = ["Report of a day", "", "# a remark"] if own.title else []
    return "\r\n".join([*before, *lines, ""]).encode(own.encoding)


def read(content: bytes) -> Dataset:
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "export.txt"
        file.write_bytes(content)
        return read_csv(file, ARM)


@REPEATABLE
@given(exported(), DIALECTS)
def test_a_dataset_in_any_dialect_is_read_back(data: Dataset, own: SimpleNamespace) -> None:
    back = read(written(data, own))
    assert sorted(back.markers) == sorted(data.markers)  # wide ones stand in the order of their columns
    order = [back.markers.index(name) for name in data.markers]
    for what in ("run_id", "pose_id"):
        np.testing.assert_array_equal(getattr(back, what), getattr(data, what))
    for what in ("q", "wrench", "point", "sigma"):
        np.testing.assert_allclose(getattr(back, what), getattr(data, what), rtol=1e-12, atol=1e-12)
    for what in ("before", "after"):
        read_back = getattr(back, what)[:, order]
        np.testing.assert_allclose(read_back, getattr(data, what), rtol=1e-12, atol=1e-12, err_msg=what)
    np.testing.assert_array_equal(back.is_measured[:, order], data.is_measured)
    if data.precision is not None:
        np.testing.assert_allclose(back.precision[:, order], data.precision, rtol=1e-12)


def drawn_spoilt(draw: Callable, content: bytes, patterns: list[bytes], words: list[bytes]) -> bytes:
    """A file of which up to three tokens, bytes or lines are replaced, doubled, swapped or dropped."""
    for _ in range(draw(st.integers(1, 3))):
        pattern = draw(st.sampled_from(patterns))
        spans = [m.span() for m in re.finditer(pattern, content)] or [(0, 0)]
        (a, b), (c, d) = (draw(st.sampled_from(spans)) for _ in range(2))
        other = st.sampled_from([b"", content[a:b] * 2, content[c:d], content[a:b]])
        content = content[:a] + draw(st.one_of(other, st.sampled_from(words))) + content[b:]
    return content


NASTY = [
    *b"nan -inf inf 1e999 1e-320 1e200 1e308 -1 0 -0.0 1 1_0 1e . 0b1 0x1 1979-05-27 true True".split(),
    *(
        b"9" * 400,
        b"9" * 5000,
        b"0x" + b"f" * 9000,
        b"1 2 3",
        b"",
        b"\0",
        b"\xff",
        b"\xc3",
        b"\n",
        b"\r",
        b"\t",
    ),
    *(b" ", "\ufeff".encode(), "é".encode(), "\u2028".encode(), b'"', b'""', b"'", b",", b"#", b"1 2"),
]
CELLS = [
    *(
        b'"\n',
        b",,",
        b";",
        b"\r\n",
        "１".encode(),
        "-∞".encode(),
        "µm".encode(),
        b"//",
        b"=1+1",
        b"x" * 140_000,
    ),
    *(b"P1", b"P4", b"run", b"sigma_rad", b"marker", b"[mm]", b"1.234,5"),
]


def check_reading(content: bytes) -> None:
    """Either a sound dataset or an InputError of one line that names the file."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "export.txt"
        file.write_bytes(content)
        try:
            back = read_csv(file, ARM)
        except InputError as err:
            one_line(err, file)
            return
        assert back.n_runs == len(set(back.run_id.tolist())) >= 1
        assert set(back.markers) <= set(ARM.markers)
        assert ((back.q >= LOWER - 1e-6) & (back.q <= UPPER + 1e-6)).all()
        write_csv(back, ARM, file)  # what was read can be written and read again
        again = read_csv(file, ARM)
    for field in fields(Dataset):
        np.testing.assert_array_equal(getattr(again, field.name), getattr(back, field.name))


@FUZZ
@given(exported(), DIALECTS, st.data())
def test_no_mutation_of_a_file_crashes_the_reader(
    data: Dataset, own: SimpleNamespace, choose: st.DataObject
) -> None:
    patterns = [rb"[^,;|\t\n]+", rb"[^\n]*\n", rb"[\s\S]{1,20}"]
    check_reading(drawn_spoilt(choose.draw, written(data, own), patterns, NASTY + CELLS))


TOML = {name: (MODELS / name / "elastic.toml").read_bytes() for name in ("arm_6r", "single_link")}
XML = {name: (MODELS / name / "rigid.xml").read_bytes() for name in ("arm_6r", "single_link")}
MARKS = [
    *rb"""\ \u0000 &#10; &#0; &a; & ''' = [ ] [[ ]] { } {} [] < > /> </body> <!-- --> / ../..""".split(),
    *(b'"""', b"<![CDATA[", b"]]>", b"<?x?>", b"[" * 3000, b"{a=" * 3000, b"a." * 3000, b"x" * 5000),
    *(b"<!DOCTYPE m>", b"<include file='/etc/passwd'/>", b"<replicate count='999'/>", b"<body/>"),
    *(b"<body name='link_1'/>", b"<joint/>", b"<default><joint/></default>", b"<body>" * 100, b"xmlns='a'"),
    *(b"<compiler angle='degree'/>", b"<compiler meshdir='..'/>", b"<mesh file='../x.stl'/>"),
    *(b"<mesh file='" + b"x" * 5000 + b"'/>", b"link_1", b"joint_1", b"tool", b"probe", b"name", b"tube"),
    *(b"compliance", b"m", b"link", b"[1, [2.0, 'a']]", b"{value = 1, a = {unit = true}}"),
]


def check_loading(name: str, content: bytes, file: str) -> None:
    """Either an arm in which everything is sound, or an InputError of one line."""
    with tempfile.TemporaryDirectory() as parent:
        folder = Path(shutil.copytree(MODELS / name, Path(parent) / "arm"))
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
        np.testing.assert_allclose(link.beam_axes.T @ link.beam_axes, np.eye(3), rtol=0, atol=1e-14)
        d = np.sqrt(np.diag(link.compliance))
        assert np.linalg.eigvalsh(link.compliance / np.outer(d, d))[0] > 0
        assert np.isfinite(np.linalg.inv(link.compliance)).all()
    assert all(np.isfinite(1 / joint.compliance) for joint in arm.joints)


BYTES = st.one_of(st.binary(max_size=300), st.text(max_size=300).map(lambda s: s.encode("utf-8", "replace")))


@FUZZ
@given(st.one_of(BYTES, st.text('0123456789.-e,\n"P', max_size=300).map(lambda s: f"{HEADER}\n{s}".encode())))
def test_no_bytes_crash_the_reader(content: bytes) -> None:
    check_reading(content)


@pytest.mark.parametrize(("file", "files"), [("elastic.toml", TOML), ("rigid.xml", XML)])
@FUZZ
@given(data=st.data())
def test_nothing_in_a_file_of_an_arm_crashes_the_reader(
    file: str, files: dict[str, bytes], data: st.DataObject
):
    patterns = [rb"[-+.\d][-+.\de]*", rb"\w+", rb'"[^"\n]*"', rb"<[^>]*>", rb"[^\n]*\n", rb"[\s\S]"]
    name, own = data.draw(st.sampled_from(sorted(files))), data.draw(BYTES)
    check_loading(name, drawn_spoilt(data.draw, files[name], patterns, NASTY + MARKS), file)
    for content in (own, b"<mujoco>" + own + b"</mujoco>"):
        check_loading("single_link", content, file)
