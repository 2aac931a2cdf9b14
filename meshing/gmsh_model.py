"""gmsh through its API: a session that cleans up after itself, and the filling of polygons with cells."""

from __future__ import annotations

import contextlib
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np

_OPTIONS = (
    "General.Terminal",
    "Mesh.MeshSizeMax",
    "Mesh.Algorithm",
    "Mesh.RecombinationAlgorithm",
    "Mesh.ElementOrder",
)
_TEXT_OPTIONS = ("Geometry.OCCTargetUnit",)
_MOST_STATEMENTS = 10_000
_FLATTEST = 0.05  # smallest sine of a corner of an acceptable quadrilateral


@contextmanager
def gmsh_session(name: str) -> Iterator[object]:
    """A gmsh model of our own, removed afterwards; gmsh itself is ended only if it was started here.

    Raises
    ------
    RuntimeError
        gmsh cannot be loaded.
    """
    try:
        import gmsh
    except (ImportError, OSError) as error:  # OSError: the wheel's library lacks a system library
        raise RuntimeError(
            f"gmsh could not be loaded ({error}); install it with 'pip install gmsh' and the libraries "
            "libGLU, libXcursor, libXft, libXinerama."
        ) from error
    started = not gmsh.isInitialized()
    if started:
        # Without interruptible=False gmsh takes SIGINT for good; with configuration files the result would
        # depend on the user's home.
        gmsh.initialize([], readConfigFiles=False, interruptible=False)
    previous = None if started else gmsh.model.getCurrent()
    options = {name: gmsh.option.getNumber(name) for name in _OPTIONS}
    texts = {name: gmsh.option.getString(name) for name in _TEXT_OPTIONS}
    gmsh.option.setNumber("General.Terminal", 0)
    gmsh.model.add(name)
    try:
        yield gmsh
    finally:
        if started:
            gmsh.finalize()
        else:
            gmsh.model.remove()
            for option, value in options.items():  # options belong to gmsh, not to a model
                gmsh.option.setNumber(option, value)
            for option, text in texts.items():
                gmsh.option.setString(option, text)
            if previous:
                gmsh.model.setCurrent(previous)


def drain_parser(gmsh) -> None:
    """Make gmsh forget the rest of a .geo file in which it found an error.

    It keeps the text after the error, also beyond its own end, and would put it before the next file of this
    process; every further attempt takes one statement off.
    """
    with tempfile.TemporaryDirectory() as folder:
        blank = Path(folder) / "blank.geo"
        blank.write_text("// nothing\n")
        for _ in range(_MOST_STATEMENTS):
            with contextlib.suppress(Exception):
                gmsh.merge(str(blank))
                return


def find_crossing(segments: np.ndarray) -> np.ndarray | None:
    """Where two segments cross or overlap each other, apart from shared ends; gmsh may never return from such
    an outline.

    Parameters
    ----------
    segments : (n, 2, 2) array
        Ends of the segments, m.

    Returns
    -------
    (2,) array or None
        m.
    """
    start, step = segments[:, 0], segments[:, 1] - segments[:, 0]
    gap = start[None, :, :] - start[:, None, :]
    across = step[:, None, 0] * step[None, :, 1] - step[:, None, 1] * step[None, :, 0]
    lengths = np.hypot(*step.T)
    parallel = np.abs(across) <= 1e-12 * lengths[:, None] * lengths[None, :]
    safe = np.where(parallel, 1.0, across)
    along_first = (gap[..., 0] * step[None, :, 1] - gap[..., 1] * step[None, :, 0]) / safe
    along_second = (gap[..., 0] * step[:, None, 1] - gap[..., 1] * step[:, None, 0]) / safe
    inside_first, touches_first = _within(along_first)
    inside_second, touches_second = _within(along_second)
    crossing = ~parallel & (inside_first & touches_second | touches_first & inside_second)
    where = np.argwhere(crossing)
    return start[where[0, 0]] + along_first[tuple(where[0])] * step[where[0, 0]] if len(where) else None


def find_meeting(segments: np.ndarray, ends: np.ndarray) -> np.ndarray | None:
    """Where two curves meet in nodes that lie at one place but are not one node; gmsh may never return from
    such an outline.

    The two faces of a slit lie on each other all along and are left alone.

    Parameters
    ----------
    segments : (n, 2, 2) array
        Ends of the segments, m.
    ends : (n, 2) int array
        Node tags of the ends.

    Returns
    -------
    (2,) array or None
        m.
    """
    places, tags = segments.reshape(-1, 2), ends.ravel()
    directions = np.repeat(segments[:, 1] - segments[:, 0], 2, axis=0)
    directions = directions / np.hypot(*directions.T)[:, None]
    distance = np.abs(places[:, None] - places[None]).max(axis=2)
    same = (distance <= 1e-9 * np.ptp(places, axis=0).max()) & (tags[:, None] != tags[None])
    along = (
        np.abs(
            directions[:, None, 0] * directions[None, :, 1] - directions[:, None, 1] * directions[None, :, 0]
        )
        <= 1e-9
    )
    for one in np.unique(tags[np.argwhere(same)[:, 0]]):
        mine = tags == one
        others = same[mine].any(axis=0)
        if not along[np.ix_(mine, others)].any():
            return places[mine][0]
    return None


def _within(parameter: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Parameters on a segment without and with its ends."""
    return (parameter > 1e-9) & (parameter < 1 - 1e-9), (parameter > -1e-9) & (parameter < 1 + 1e-9)


def fill_polygon(
    loops: Sequence[np.ndarray], embedded: np.ndarray, size: float
) -> tuple[np.ndarray, list[list[int]]]:
    """Quadrilaterals and triangles inside a polygon; its sides are kept whole.

    Parameters
    ----------
    loops : sequence of (n, 2) array
        The outer loop, then the loops of holes, any direction, m.
    embedded : (n, 2) array
        Points inside that become vertices, m.
    size : float
        Largest edge length, m.

    Returns
    -------
    inner : (n, 2) array
        New vertices, m.
    cells : list of list of int
        Counter-clockwise; numbers count the loops' points, then the embedded ones, then the new ones.

    Raises
    ------
    RuntimeError
        The sides cross each other, or gmsh fails.
    """
    crossing = find_crossing(
        np.vstack([np.stack([loop, np.roll(loop, -1, axis=0)], axis=1) for loop in loops])
    )
    if crossing is not None:
        raise RuntimeError(
            f"the outline of what is to be filled by gmsh crosses itself near ({crossing[0]:.6g}, "
            f"{crossing[1]:.6g}) m."
        )
    lengths = [np.hypot(*(np.roll(loop, -1, axis=0) - loop).T) for loop in loops]
    scale = max(np.ptp(loops[0], axis=0).max(), 1e-300)
    with gmsh_session("polygon") as gmsh:
        try:
            geometry = gmsh.model.geo
            point_tags, curve_loops = [], []
            for loop, length in zip(loops, lengths):
                # Unit scale: gmsh's tolerances are absolute.
                near = 0.5 * (length + np.roll(length, 1)) / scale
                tags = [geometry.addPoint(x / scale, y / scale, 0.0, h) for (x, y), h in zip(loop, near)]
                lines = [geometry.addLine(a, b) for a, b in zip(tags, tags[1:] + tags[:1])]
                for line in lines:
                    geometry.mesh.setTransfiniteCurve(line, 2)
                point_tags += tags
                curve_loops.append(geometry.addCurveLoop(lines))
            surface = geometry.addPlaneSurface(curve_loops)
            inside = [geometry.addPoint(x / scale, y / scale, 0.0, size / scale) for x, y in embedded]
            geometry.synchronize()
            if inside:
                gmsh.model.mesh.embed(0, inside, 2, surface)
            gmsh.option.setNumber("Mesh.MeshSizeMax", size / scale)
            gmsh.option.setNumber("Mesh.ElementOrder", 1)
            gmsh.option.setNumber("Mesh.Algorithm", 6)
            # Blossom's repositioning may fold the cells around embedded points over each other.
            gmsh.option.setNumber("Mesh.RecombinationAlgorithm", 0)
            gmsh.model.mesh.setRecombine(2, surface)
            gmsh.model.mesh.generate(2)
            number = {}
            for position, tag in enumerate(point_tags + inside):
                number[int(gmsh.model.mesh.getNodes(0, tag)[0][0])] = position
            coordinates = dict(zip(number.values(), np.vstack([*loops, embedded.reshape(-1, 2)])))
            tags, positions, _ = gmsh.model.mesh.getNodes(2, surface)
            inner = positions.reshape(-1, 3)[:, :2] * scale
            for i, tag in enumerate(tags):
                number[int(tag)] = len(point_tags) + len(inside) + i
            coordinates.update(zip(range(len(coordinates), len(coordinates) + len(inner)), inner))
            cells = []
            for kind, _, nodes in zip(*gmsh.model.mesh.getElements(2, surface)):
                for corners in np.asarray(nodes).reshape(-1, 3 if kind == 2 else 4):
                    cells.append([number[int(tag)] for tag in corners])
        except Exception as error:
            raise RuntimeError(
                f"gmsh could not fill the polygon around ({loops[0][:, 0].mean():.6g}, "
                f"{loops[0][:, 1].mean():.6g}) m: {error}"
            ) from error
    wanted = abs(polygon_area(loops[0])) - sum(abs(polygon_area(loop)) for loop in loops[1:])
    covered = sum(abs(polygon_area(np.array([coordinates[v] for v in cell]))) for cell in cells)
    if abs(covered - wanted) > 1e-9 * wanted:
        raise RuntimeError(
            f"gmsh's cells around ({loops[0][:, 0].mean():.6g}, {loops[0][:, 1].mean():.6g}) m overlap or "
            "leave gaps."
        )
    return inner, [piece for cell in cells for piece in _sound_pieces(cell, coordinates)]


def polygon_area(polygon: np.ndarray) -> float:
    """Signed area of a polygon (n, 2), positive if counter-clockwise."""
    following = np.roll(polygon, -1, axis=0)
    return 0.5 * float((polygon[:, 0] * following[:, 1] - polygon[:, 1] * following[:, 0]).sum())


def _sound_pieces(cell: list[int], coordinates: dict[int, np.ndarray]) -> list[list[int]]:
    """The cell counter-clockwise; a quadrilateral that is not safely convex in two triangles."""
    points = np.array([coordinates[v] for v in cell])
    ahead, behind = np.roll(points, -1, axis=0) - points, np.roll(points, 1, axis=0) - points
    turns = (
        (ahead[:, 0] * behind[:, 1] - ahead[:, 1] * behind[:, 0]) / np.hypot(*ahead.T) / np.hypot(*behind.T)
    )
    if polygon_area(points) < 0:
        return _sound_pieces(cell[::-1], coordinates)
    if len(cell) == 3 or turns.min() > _FLATTEST:
        return [cell]
    worst = int(turns.argmin())
    a, b, c, d = (cell[(worst + i) % 4] for i in range(4))
    return [[a, b, c], [a, c, d]]
