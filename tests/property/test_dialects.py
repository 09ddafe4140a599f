"""A dataset comes back from our file and from anybody's dialect; from other files only InputError escapes."""

import re
import tempfile
from dataclasses import dataclass, fields
from pathlib import Path
from random import Random

import numpy as np
from blockwise import read_both_ways
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from refused import one_line

from testbench.arm.folder import load_arm
from testbench.data.dataset import Dataset, select, split
from testbench.data.names import LARGEST, LEAST
from testbench.data.read_pairs import read_csv
from testbench.data.scatter import SIGMA_RANGE
from testbench.data.write import write_csv
from testbench.errors import InputError

ROOT = Path(__file__).parents[2]
ARM = load_arm(ROOT / "models" / "kr500_l480")
HEADER = (ROOT / "docs" / "example_dataset.csv").read_text(encoding="utf-8").partition("\n")[0]
LOWER, UPPER = ARM.limits
REPEATABLE = settings(deadline=None, derandomize=True, database=None, max_examples=60)
FUZZ = settings(REPEATABLE, max_examples=150)
LENGTHS = {"m": 1.0, "mm": 1e-3, "um": 1e-6, "in": 0.0254}
ANGLES = {"rad": 1.0, "deg": np.pi / 180, "mrad": 1e-3}
FORCES, MOMENTS = {"N": 1.0, "kN": 1e3}, {"Nm": 1.0, "Nmm": 1e-3}
APART = np.array([0.0, 11.0, 22.0])  #: Three equal coordinates are no place.
STATES = {"before": "Unloaded", "after": "loaded"}
MOST = min(LARGEST.values())
ANY = st.floats(-MOST, MOST).filter(lambda x: x == 0 or abs(x) >= LEAST)
SOME = st.floats(-5, 5).filter(lambda x: x == 0 or abs(x) >= 1e6 * LEAST)
ID = st.integers(-(2**63), 2**63 - 1)


@dataclass(frozen=True)
class Dialect:
    """How somebody writes."""

    delimiter: str
    decimal: str
    encoding: str
    suffix: str  #: Of a unit in a name.
    length: str
    angle: str
    force: str
    moment: str
    wide: bool  #: All markers in a row.
    states: bool  #: A row a state.
    capitals: bool
    title: bool  #: Lines before the header.
    seed: int  #: Of the order of columns and rows.


@st.composite
def dialects(draw: st.DrawFn) -> Dialect:
    delimiter = draw(st.sampled_from([",", ";", "\t", "|"]))
    return Dialect(
        delimiter=delimiter,
        decimal=draw(st.sampled_from(".," if delimiter != "," else ".")),
        encoding=draw(st.sampled_from(["utf-8", "utf-8-sig", "utf-16", "cp1252"])),
        suffix=draw(st.sampled_from(["_{}", " [{}]", " ({})", " in {}", " / {}"])),
        length=draw(st.sampled_from(list(LENGTHS))),
        angle=draw(st.sampled_from(list(ANGLES))),
        force=draw(st.sampled_from(list(FORCES))),
        moment=draw(st.sampled_from(list(MOMENTS))),
        wide=draw(st.booleans()),
        states=draw(st.booleans()),
        capitals=draw(st.booleans()),
        title=draw(st.booleans()),
        seed=draw(st.integers(0, 999)),
    )


@st.composite
def datasets(draw: st.DrawFn) -> Dataset:
    """One to four runs of any numbers that are read, extreme ones too; orientations and set-ups or none."""
    runs, m = draw(st.integers(1, 4)), draw(st.integers(1, 3))

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
        markers=tuple(draw(st.permutations(ARM.markers))[:m]),
        run=integers(unique=True),
        pose=integers(),
        q=LOWER + (UPPER - LOWER) * draw(arrays(float, (runs, 6), elements=st.floats(0, 1))),
        wrench=numbers(runs, 6),
        point=numbers(runs, 3),
        before=places(runs, m),
        after=places(runs, m),
        sigma=draw(st.floats(*SIGMA_RANGE)),
        rotation_before=numbers(runs, 3) if turned else None,
        rotation_after=numbers(runs, 3) if turned else None,
        sigma_rotation=draw(st.floats(*SIGMA_RANGE)) if turned else None,
        station=integers() if draw(st.booleans()) else None,
        taken_off=draw(arrays(bool, runs)) if draw(st.booleans()) else None,
    )


@st.composite
def exported(draw: st.DrawFn) -> Dataset:
    """Runs as an instrument exports them, each in a pose of its own, some targets lost."""
    runs, m = draw(st.integers(1, 4)), draw(st.integers(1, 3))
    seen = draw(arrays(bool, (runs, m)))
    seen[0] = True
    sigma = draw(st.floats(1e-6, 1e-3))
    wrench, point, before, after = (
        draw(arrays(float, (runs, *shape), elements=SOME)) for shape in ((6,), (3,), (m, 3), (m, 3))
    )
    return Dataset(
        markers=tuple(draw(st.permutations(ARM.markers))[:m]),
        run=np.arange(runs) + draw(st.integers(-9, 9)),
        pose=np.arange(runs) * 2 + 1,
        q=LOWER + (UPPER - LOWER) * draw(arrays(float, (runs, 6), elements=st.floats(0.1, 0.9))),
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
    poses = np.unique(data.pose).tolist()
    if chosen := choose.draw(st.sets(st.sampled_from(poses), max_size=len(poses) - 1)):
        mask = np.isin(data.pose, sorted(chosen))
        inside, outside = split(data, np.array(sorted(chosen)))
        for part, here in ((inside, mask), (outside, ~mask)):
            own = {f.name: getattr(data, f.name) for f in fields(Dataset)}
            own = {name: x[here] if isinstance(x, np.ndarray) else x for name, x in own.items()}
            assert bits(part) == bits(Dataset(**own)) == bits(select(data, here))


def written(data: Dataset, own: Dialect) -> bytes:
    """The dataset as text."""
    random, rows = Random(own.seed), list[dict[str, str]]()

    def name(quantity: str, unit: str) -> str:
        whole = quantity.strip("_") + own.suffix.format(unit)
        return whole.upper() if own.capitals else whole

    def put(row: dict[str, str], quantity: str, unit: str, scale: float, values: np.ndarray) -> None:
        for axis, value in zip("xyz", values, strict=True):
            row[name(f"{quantity}_{axis}", unit)] = repr(float(value) / scale).replace(".", own.decimal)

    for r in range(data.runs):
        common = {"run": str(data.run[r]), "Pose": str(data.pose[r]), "note": "abc", "time": "10:15"}
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
                if not data.seen[r, m]:
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
        return read_both_ways(file, ARM)[0]


@REPEATABLE
@given(exported(), dialects())
def test_a_dataset_in_any_dialect_is_read_back(data: Dataset, own: Dialect) -> None:
    back = read(written(data, own))
    assert sorted(back.markers) == sorted(data.markers)  # wide ones stand in the order of their columns
    order = [back.markers.index(name) for name in data.markers]
    for what in ("run", "pose"):
        np.testing.assert_array_equal(getattr(back, what), getattr(data, what))
    for what in ("q", "wrench", "point", "sigma"):
        np.testing.assert_allclose(getattr(back, what), getattr(data, what), rtol=1e-12, atol=1e-12)
    for what in ("before", "after"):
        read_back = getattr(back, what)[:, order]
        np.testing.assert_allclose(read_back, getattr(data, what), rtol=1e-12, atol=1e-12, err_msg=what)
    np.testing.assert_array_equal(back.seen[:, order], data.seen)
    if data.precision is not None:
        np.testing.assert_allclose(back.precision[:, order], data.precision, rtol=1e-12)


NASTY = [
    *(b"", b"nan", b"inf", b"-1e999", b"1e-400", b"1_0", b"0x1", b"9" * 400, b"9" * 5000, b"-0.0", b"1e308"),
    *(b'"', b'""', b'"\n', b"'", b",", b",,", b";", b"\t", b"\n", b"\r", b"\r\n", b"\0", b"\xff", b"\xc3"),
    *("\ufeff".encode(), "é".encode(), "\u2028".encode(), "１".encode(), "-∞".encode(), "µm".encode()),
    *(b"P1", b"P4", b"run", b"sigma_rad", b"marker", b"=1+1", b"#", b"//", b"True", b" ", b"x" * 140_000),
    *(b"[mm]", b"1.234,5"),
]


def check_reading(content: bytes) -> None:
    """Either a sound dataset or an InputError of one line that names the file."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "export.txt"
        file.write_bytes(content)
        try:
            back = read_both_ways(file, ARM)[0]
        except InputError as err:
            one_line(err, file)
            return
        assert back.runs == len(set(back.run.tolist())) >= 1
        assert set(back.markers) <= set(ARM.markers)
        assert ((back.q >= LOWER - 1e-6) & (back.q <= UPPER + 1e-6)).all()
        write_csv(back, ARM, file)  # what was read can be written and read again
        again = read_csv(file, ARM)
    for field in fields(Dataset):
        np.testing.assert_array_equal(getattr(again, field.name), getattr(back, field.name))


@FUZZ
@given(
    st.one_of(
        st.binary(max_size=300),
        st.text(max_size=300).map(lambda s: s.encode("utf-8", "replace")),
        st.text(alphabet='0123456789.-e,\n"P', max_size=300).map(lambda body: f"{HEADER}\n{body}".encode()),
    )
)
def test_no_bytes_crash_the_reader(content: bytes) -> None:
    check_reading(content)


@FUZZ
@given(exported(), dialects(), st.data())
def test_no_mutation_of_a_file_crashes_the_reader(data: Dataset, own: Dialect, choose: st.DataObject) -> None:
    """Up to three tokens, lines or bytes are replaced, doubled, swapped or dropped."""
    content = written(data, own)
    for _ in range(choose.draw(st.integers(1, 3))):
        pattern = choose.draw(st.sampled_from([rb"[^,;|\t\n]+", rb"[^\n]*\n", rb"[\s\S]{1,20}"]))
        spans = [m.span() for m in re.finditer(pattern, content)]
        (a, b), (c, d) = (choose.draw(st.sampled_from(spans or [(0, 0)])) for _ in range(2))
        other = st.sampled_from([b"", content[a:b] * 2, content[c:d], content[a:b]])
        content = content[:a] + choose.draw(st.one_of(other, st.sampled_from(NASTY))) + content[b:]
    check_reading(content)
