"""The space of a recording: the arm, what is drawn in its poses, maps of errors, and the eye."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from rerun.components import FillMode

from testbench.errors import Array
from testbench.plant.shapes import BodyFrames, Shape, join_meshes, quaternions_from_rotations, visual_shapes
from testbench.report.colours import GREY, MEASURED, SCALE, Colour
from testbench.report.markdown import Markdown, as_markdown, place
from testbench.report.recording.stream import Pen, snake, text_view
from testbench.report.scene import (
    ErrorScale,
    Layer,
    PlaceMap,
    frames_along,
    label_places,
    legs,
    scale_of,
    shades,
    squares,
    tube_colours,
)
from testbench.report.schema import show
from testbench.workflows.cell import Cell
from testbench.workflows.model_names import in_words

THROUGH = 70  #: Opacity of what is seen through, of 255.
GHOST = (*MEASURED, THROUGH)  #: The arm under load.
THICK = {"dots": 0.008, "specks": 0.004, "arrows": 0.004, "lines": 0.0025, "weights": 0.0025, "tubes": 0.012}
"""Radius of what is drawn over the size of what is in view [1]."""
HALF_VIEW = np.tan(np.deg2rad(27.5))  #: Tangent of half the viewer's vertical angle of view.
ASPECT = 1.25  #: Width over height of the narrowest pane that shows the arm [1].
HEAD = 0.15  #: Width of the head of a tracker [m].
SIDE = (0.35, 0.9, 0.25)  #: Where the eye is: ahead along the reach of the arm, beside it, above [1].


def write_arm(pen: Pen, cell: Cell, root: str, rigid: BodyFrames, bent: BodyFrames | None) -> None:
    """The arm in every pose: its bodies in grey, and once more those that are seen to move under load.

    A ghost of another body would flicker through its surface.
    """
    pen.still("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP)
    names, shapes = cell.room.body_names, visual_shapes(cell.room)
    hidden, moving = {cell.arm.load_point, *cell.arm.markers}, [] if bent is None else _moving(rigid, bent)
    for body in sorted({shape.body for shape in shapes}):
        if names[body] in hidden:  # drawn by their roles
            continue
        own = [shape for shape in shapes if shape.body == body]
        path = rr.new_entity_path(["world", root, names[body]])
        pen.still(path, *_solids(own, None))
        _write_frames(pen, path, rigid, body)
        if bent is not None and body in moving:
            path = rr.new_entity_path(["world", f"{root}_deflected", names[body]])
            pen.still(path, *_solids(own, GHOST))
            _write_frames(pen, path, bent, body)


def _write_frames(pen: Pen, path: str, frames: BodyFrames, body: int) -> None:
    turns = quaternions_from_rotations(frames.rotations[:, body])
    pen.rows(path, rr.Transform3D.columns(translation=frames.positions[:, body], quaternion=turns))


def _moving(rigid: BodyFrames, bent: BodyFrames) -> list[int]:
    """Bodies that are seen to move."""
    shift = np.linalg.norm(bent.positions - rigid.positions, axis=2).max(axis=0)
    return np.flatnonzero(shift > 0.005 * reach(rigid)).tolist()


def reach(frames: BodyFrames) -> float:
    """Largest distance of a body from the foot of the arm, the scale of symbols [m]."""
    arm = frames.positions[:, 1:]  # the world is first
    return float(np.linalg.norm(arm - arm[:, :1], axis=-1).max())


def _solids(shapes: Sequence[Shape], colour: Colour | None) -> list[rr.AsComponents]:
    """The shapes of a body, one archetype a kind; in shades of grey where no colour is given."""
    solids: list[rr.AsComponents] = []
    for kind in dict.fromkeys(shape.kind for shape in shapes):
        own = [shape for shape in shapes if shape.kind == kind]
        size, centre = np.array([s.half_sizes for s in own]), np.array([s.centre for s in own])
        R = np.array([s.rotation for s in own])
        radius = size[:, 0]
        length = 2 * size[:, 2]
        look: dict[str, Any] = {
            "quaternions": quaternions_from_rotations(R),
            "colors": [colour or _grey(s.rgba) for s in own],
            "fill_mode": FillMode.Solid,
        }
        if kind == "mesh":
            solids.append(_mesh(own, look["colors"]))
        elif kind == "box":
            solids.append(rr.Boxes3D(half_sizes=size, centers=centre, **look))
        elif kind == "cylinder":
            solids.append(rr.Cylinders3D(lengths=length, radii=radius, centers=centre, **look))
        elif kind == "capsule":  # Rerun's begins at its origin
            start = centre - R[:, :, 2] * size[:, 2:]
            solids.append(rr.Capsules3D(lengths=length, radii=radius, translations=start, **look))
        else:
            solids.append(rr.Ellipsoids3D(half_sizes=size, centers=centre, **look))
    return solids


def _grey(rgba: Array) -> Colour:
    """Grey of about the brightness of a colour, neither black nor white: colours are roles."""
    level = round(255 * (0.35 + 0.45 * float(rgba[:3] @ [0.299, 0.587, 0.114])))
    return level, level, level


def _mesh(shapes: Sequence[Shape], colours: Sequence[Colour]) -> rr.Mesh3D:
    """All meshes of a body as one."""
    mesh, counts = join_meshes(shapes)
    return rr.Mesh3D(
        vertex_positions=mesh.vertices,
        vertex_normals=mesh.normals,
        triangle_indices=mesh.faces,
        vertex_colors=np.repeat(np.array(colours, dtype=np.uint8)[:, :3], counts, axis=0),
        albedo_factor=(255, 255, 255, *colours[0][3:]),  # of a vertex the viewer takes no transparency
    )


def write_layer(rows: Pen, path: str, layer: Layer, size: float, scale: ErrorScale | None) -> None:
    """What is in every pose, where it is there; what stands still once. Tubes have colours of the scale."""
    if layer.kind == "trackers":
        _write_trackers(rows, path, layer)
        return
    if layer.kind == "tubes":
        _write_tubes(rows, path, layer, THICK[layer.kind] * size, scale)
        return
    if layer.semi_axes is not None:
        _write_ellipsoids(rows, path, layer.at[0], layer.semi_axes, layer.colour)
        return
    if layer.kind == "faces":
        _write_faces(rows, path, layer, THICK["lines"] * size)
        return
    ends = layer.at if layer.to is None else layer.to
    known = np.isfinite(layer.at).all(axis=2) & np.isfinite(ends).all(axis=2)
    counts = known.sum(axis=1)
    at = layer.at[known]
    to = ends[known]
    look: dict[str, Any] = {"colors": layer.colour}
    if layer.kind == "cylinders":
        look["fill_mode"] = FillMode.Solid
    else:
        look["radii"] = THICK[layer.kind] * size
    kind, parts = _parts(layer, at, to)
    if len(counts) == len(rows.times[0].as_arrow_array()):
        rows.still(path, kind.from_fields(**look))
        rows.rows(path, kind.columns(**parts).partition(counts))
    else:
        rows.still(path, kind.from_fields(**look, **parts))
    if layer.kind == "weights":
        solid = rr.Cylinders3D.from_fields(
            lengths=2 * layer.radius, radii=layer.radius, colors=layer.colour, fill_mode=FillMode.Solid
        )
        rows.still(f"{path}_body", solid)
        down = np.array([0, 0, layer.radius])
        rows.rows(f"{path}_body", rr.Cylinders3D.columns(centers=to - down).partition(counts))
    _write_names(rows, f"{path}_names", layer)


def _write_trackers(rows: Pen, path: str, layer: Layer) -> None:
    """Heads on tripods, with their names above."""
    [heads] = layer.at
    half = np.array([HEAD / 2, HEAD / 2, HEAD])
    box = rr.Boxes3D(
        centers=heads + np.array([0, 0, HEAD]),
        half_sizes=[half] * len(heads),
        colors=layer.colour,
        fill_mode=FillMode.Solid,
    )
    rows.still(path, box)
    rows.still(f"{path}_legs", rr.LineStrips3D([*legs(heads)], colors=layer.colour, radii=HEAD / 10))
    if layer.labels:
        rows.names(f"{path}_names", heads + np.array([0, 0, 2 * HEAD]), list(layer.labels), layer.colour)


def _write_faces(rows: Pen, path: str, layer: Layer, radius: float) -> None:
    """Squares that are seen through from both sides, their edges, normals and names."""
    assert layer.to is not None  # by its kind
    corners, way = squares(layer), layer.to[0] - layer.at[0]
    first = 4 * np.arange(len(corners))[:, None, None]
    front = np.array([(0, 1, 2), (0, 2, 3)])
    normal = way / np.linalg.norm(way, axis=1, keepdims=True)
    square = rr.Mesh3D(
        vertex_positions=corners.reshape(-1, 3),
        vertex_normals=np.repeat(normal, 4, axis=0),
        triangle_indices=(first + np.concatenate([front, front[:, ::-1]])).reshape(-1, 3),
        albedo_factor=(*layer.colour, THROUGH),
    )
    rows.still(path, square)
    edges = [*np.concatenate([corners, corners[:, :1]], axis=1)]
    rows.still(f"{path}_edges", rr.LineStrips3D(edges, colors=layer.colour, radii=radius))
    normals = rr.Arrows3D(origins=layer.at[0], vectors=way, colors=layer.colour, radii=radius)
    rows.still(f"{path}_normals", normals)
    _write_names(rows, f"{path}_names", layer)


def _write_ellipsoids(rows: Pen, path: str, at: Array, semi_axes: Array, colour: Colour) -> None:
    """Ellipsoids as nets, through which the arm is seen; at (k, 3) and their semi-axes, a row each [m]."""
    sizes = np.linalg.norm(semi_axes, axis=2)
    known = np.maximum(sizes, 1e-12)[:, :, None]
    turns = (semi_axes / known).transpose(0, 2, 1)
    turns[:, :, 2] *= np.sign(np.linalg.det(turns))[:, None]  # a rotation, no mirror
    net = rr.Ellipsoids3D(
        centers=at,
        half_sizes=sizes,
        quaternions=quaternions_from_rotations(turns),
        colors=colour,
        fill_mode=FillMode.MajorWireframe,
        line_radii=-0.5,
    )
    rows.still(path, net)


def _write_tubes(rows: Pen, path: str, layer: Layer, radius: float, scale: ErrorScale | None) -> None:
    """Parts of a path, coloured by the error there; grey where there is none."""
    assert layer.to is not None  # by its kind
    strips = np.stack([layer.at[0], layer.to[0]], axis=1)
    colours = tube_colours(layer, scale)
    rows.still(path, rr.LineStrips3D(strips, colors=colours, radii=radius))


def _write_names(rows: Pen, path: str, layer: Layer) -> None:
    """Write the labels of a layer in every pose, see `label_places`."""
    places = label_places(layer)
    named = [k for k, text in enumerate(layer.labels) if text and np.isfinite(places[:, k]).any()]
    if not named:
        return
    texts, poses = [layer.labels[k] for k in named], len(places)
    if poses == 1:
        rows.names(path, places[0, named], texts, layer.colour)
        return
    rows.still(path, rr.Points3D.from_fields(colors=layer.colour, radii=0.0, show_labels=True))
    known = np.asarray(np.isfinite(places[:, named]).all(axis=2))
    there = [text for row in known for text, here in zip(texts, row, strict=True) if here]
    names = rr.Points3D.columns(positions=places[:, named][known], labels=there)
    rows.rows(path, names.partition(known.sum(axis=1)))


def _parts(layer: Layer, at: Array, to: Array) -> tuple[Any, dict[str, Array]]:
    """What draws a layer, and its parts: where they begin (n, 3) and end (n, 3) [m]."""
    if layer.kind == "arrows":
        return rr.Arrows3D, {"origins": at, "vectors": to - at}
    if layer.kind == "cylinders":
        turns, length = quaternions_from_rotations(frames_along(to - at)), np.linalg.norm(to - at, axis=1)
        radii = np.full(len(at), layer.radius)
        return rr.Cylinders3D, {
            "centers": (at + to) / 2,
            "lengths": length,
            "radii": radii,
            "quaternions": turns,
        }
    if layer.kind in ("lines", "weights"):
        return rr.LineStrips3D, {"strips": np.stack([at, to], axis=1)}
    return rr.Points3D, {"positions": at}


def orbit(eye: Array, target: Array) -> rrb.EyeControls3D:
    """A camera that turns about its target; both (3,) [m]."""
    return rrb.EyeControls3D(kind=rrb.Eye3DKind.Orbital, position=eye, look_target=target, eye_up=(0, 0, 1))


def frame(
    points: Array, radii: Array, tool: Array, aspect: float = ASPECT, above: float = SIDE[2]
) -> tuple[Array, Array]:
    """Eye and target, each (3,) [m]: as near as it can be with all spheres in view.

    Args:
        points: Their centres, (points, 3) [m].
        radii: Of the spheres, (points,) [m].
        tool: Where the arm reaches, seen from above, (2,) [m].
        aspect: Width over height of the pane [1].
        above: How steeply the eye looks down, over how far it is ahead and aside [1].
    """
    length = float(np.linalg.norm(tool))
    x, y = tool / length if length > 0 else (1.0, 0.0)
    ahead, aside, _ = SIDE
    back = np.array([aside * y + ahead * x, -aside * x + ahead * y, above])
    back /= np.linalg.norm(back)
    right = np.array([-back[1], back[0], 0]) / np.hypot(back[0], back[1])
    axes = np.column_stack([back, right, np.cross(back, right)])
    along = points @ axes
    low, high = (along - radii[:, None]).min(axis=0), (along + radii[:, None]).max(axis=0)
    target = axes @ ((low + high) / 2)
    depth, across, up = ((points - target) @ axes).T
    wide = np.maximum(np.abs(across) / aspect, np.abs(up)) + radii
    distance = float((depth + wide / HALF_VIEW).max())  # the point that needs most
    return target + distance * back, target


MAX_MAPS, MAPS_PER_ROW = 4, 3  #: Maps at most, and side by side.
TAB = 2.2  #: Width over height of a tab, above its words [1].
BALL = 0.02  #: Radius of the largest ball of a map over the size of what is in view [1].
SMALLEST = 0.4  #: Size of the ball of least error over that of the greatest [1]: colour is never alone.
KEYS = 5  #: Errors of which the words say the colour.
WORDS_SHARE = 1.6  #: Height of the words of a map over that of the words of a pose [1].
ROOT, WORDS, DIFFERENCE = "world/map", "map_words", "difference"


def sizes(share: Array) -> Array:
    """Sizes of places on the scale over that of the greatest error, (n,) [1]."""
    return SMALLEST + (1 - SMALLEST) * share


def write_map(pen: Pen, place_map: PlaceMap, names: Sequence[str], size: float) -> None:
    """A map a line, rings where there is no number; in words what colours are, and where each is largest.

    What is in view has this size [m].
    """
    scale = _scale(place_map)
    there = np.isfinite(place_map.at).all(axis=1)
    said = []
    for line in place_map.lines[-MAX_MAPS:]:
        path, known = f"{ROOT}/{snake(line.words)}", there & np.isfinite(line.values)
        share = scale.shares(line.values[known])
        balls = rr.Points3D(place_map.at[known], colors=shades(share), radii=BALL * size * sizes(share))
        pen.still(f"{path}/field", balls)
        if (there & ~known).any():
            _write_rings(pen, f"{path}/none", place_map.at[there & ~known], SMALLEST * BALL * size)
        if known.any():
            k = int(np.argmax(np.where(known, line.values, -np.inf)))
            own = f"{show(float(line.values[k]))} mm"
            word = place_map.worst_is if line is place_map.lines[-1] else "worst"
            over = place_map.at[[k]] + [0, 0, 3 * BALL * size]
            pen.names(f"{path}/worst", over, [f"{word} {own}"], SCALE[-1])
            said.append(
                f"- {as_markdown(line.words)}: {own}, {as_markdown(names[k])}, {place(place_map.at[k])}"
            )
    if place_map.difference:
        said.append(_write_difference(pen, place_map, size))
    key = ", ".join(f"{show(mm)}" for mm in scale.errors(np.linspace(0, 1, KEYS)))
    said.append(f"\nFrom small and dark blue to large and light green: {key} {scale.words}.")
    rings = [f"Rings: {place_map.without}."] if place_map.without else []
    head = [f"{place_map.title}. Where each is largest:", "\n".join(said), *rings]
    pen.documents({WORDS: Markdown("\n\n".join(head))})


def _write_difference(pen: Pen, place_map: PlaceMap, size: float) -> str:
    """The winner minus joint stiffness: balls in the colour of the one that errs less; the words for it."""
    assert place_map.difference
    ours, theirs = place_map.difference
    known = np.isfinite(place_map.at).all(axis=1) & np.isfinite(ours.values) & np.isfinite(theirs.values)
    off = (ours.values - theirs.values)[known]
    most = float(np.abs(off).max(initial=0.0)) or 1.0
    colours = np.where((off <= 0)[:, None], ours.look.colour, theirs.look.colour).astype(np.uint8)
    balls = rr.Points3D(place_map.at[known], colors=colours, radii=BALL * size * sizes(np.abs(off) / most))
    pen.still(f"{ROOT}/{DIFFERENCE}/field", balls)
    less = int((off < 0).sum())
    a = as_markdown(in_words(ours.name))
    b = as_markdown(in_words(theirs.name))
    return f"- {a} errs less than {b} in {less} of {len(off)} places, by {show(most)} mm at most"


def _write_rings(pen: Pen, path: str, centres: Array, radius: float) -> None:
    """Grey rings about centres (n, 3) [m]."""
    half, lines = np.full(centres.shape, radius), FillMode.MajorWireframe
    rings = rr.Ellipsoids3D(centers=centres, half_sizes=half, colors=GREY, fill_mode=lines, line_radii=-0.5)
    pen.still(path, rings)


def _scale(place_map: PlaceMap) -> ErrorScale:
    return scale_of(*(line.values for line in place_map.lines[-MAX_MAPS:]))


def map_tab(
    place_map: PlaceMap, arm: str, body: Array, size: float, here: Sequence[str] = ()
) -> rrb.Container:
    """The maps side by side with an arm, and words.

    Args:
        place_map: The maps.
        arm: Root of the arm's bodies; empty for none.
        body: Points of the arm, (n, 3) [m].
        size: Of all that is in view [m].
        here: Where it is said what the arm does.
    """
    at = place_map.at[np.isfinite(place_map.at).all(axis=1)]
    points = np.vstack([at, body])
    count = min(len(place_map.lines), MAX_MAPS) + bool(place_map.difference)
    across = count if count <= MAPS_PER_ROW else -(-count // 2)
    aspect = TAB * -(-count // across) / across
    eye = orbit(*frame(points, np.full(len(points), 0.04 * size), at[0, :2], aspect=aspect))
    views = [
        rrb.Spatial3DView(
            origin="world",
            name=f"{line.words}: {_typical(line.values)}",
            contents=[f"+ $origin/map/{snake(line.words)}/**", *([f"+ $origin/{arm}/**"] if arm else [])],
            eye_controls=eye,
        )
        for line in place_map.lines[-MAX_MAPS:]
    ]
    if place_map.difference:
        views.append(
            rrb.Spatial3DView(
                origin="world",
                name="Which errs less: colour of that model",
                contents=[f"+ $origin/map/{DIFFERENCE}/**", *([f"+ $origin/{arm}/**"] if arm else [])],
                eye_controls=eye,
            )
        )
    words = [text_view(WORDS, place_map.heading), *(text_view(path, "What is shown") for path in here)]
    if len(views) % across:  # a place is left
        said = rrb.Vertical(*words, row_shares=[WORDS_SHARE, *[1] * len(here)])
        return rrb.Grid(*views, said, grid_columns=across, name=place_map.heading)
    return rrb.Vertical(
        rrb.Grid(*views, grid_columns=across),
        rrb.Horizontal(*words),
        row_shares=[13, 4],
        name=place_map.heading,
    )


def _typical(values: Array) -> str:
    known = values[np.isfinite(values)]
    if not known.size:
        return "none"
    return f"median {show(float(np.median(known)))} mm"
