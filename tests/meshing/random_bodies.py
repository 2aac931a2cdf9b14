"""Beams and plates with random notches, holes, cracks and points, by seeds."""

import math

import numpy as np
import shapely

from meshing import Beam, CrackLine, Hole, Plate, VNotch

BEAMS, PLATES = 75, 50  # for each seed


def beams(seed):
    """(beam, options of `mesh`) that can be drawn, `BEAMS` of them."""
    random = np.random.default_rng(seed)
    found = []
    while len(found) < BEAMS:
        height = 0.005 * 10 ** random.uniform(-0.5, 0.5)
        length = height * random.uniform(1, 40)
        crowd = height * random.uniform(0.5, 6)  # features stand within this
        middle = random.uniform(0.1, 0.9) * length

        def x(length=length, crowd=crowd, middle=middle):
            return float(np.clip(middle + crowd * random.uniform(-0.5, 0.5), 0.01 * length, 0.99 * length))

        notches = [
            VNotch(
                x(),
                height * random.uniform(0.05, 0.95),
                random.choice([0.0, 0.05, 2.0, 20.0, 80.0]),
                random.choice([0.0, 0.0, random.uniform(-40, 40)]),
                edge=random.choice(["top", "bottom"]),
            )
            for _ in range(random.integers(0, 4))
        ]
        holes = [
            Hole(x(), height * random.uniform(0.1, 0.9), height * random.uniform(0.03, 0.6))
            for _ in range(random.integers(0, 3))
        ]
        area = shapely.box(0, 0, length, height)
        for notch in notches:
            area = area.difference(
                shapely.Polygon(Beam(length, height).triangle(notch)).buffer(1e-3 * height)
            )
        area = _without(area, holes, height)
        starts = [(x(), height * random.uniform(0, 1)) for _ in range(random.integers(0, 3))]
        cracks = _inside(area, [_line(random, start, height) for start in starts])
        points = {f"p{i}": (x(), height * random.choice([0.0, random.uniform(0, 1), 1.0])) for i in range(2)}
        options = {"points": points if random.random() < 0.4 else None}
        if random.random() < 0.2:
            options["size"] = height * random.uniform(0.3, 2)
        try:
            beam = Beam(length, height, notches, holes, cracks=cracks)
            for name, point in (options["points"] or {}).items():
                beam.check_point(name, point)
        except ValueError:
            continue
        found.append((beam, options))
    return found


def plates(seed):
    """(plate, options of `mesh`) that can be drawn, `PLATES` of them."""
    random = np.random.default_rng(1000 + seed)
    found = []
    while len(found) < PLATES:
        extent = 10 ** random.uniform(-2, 0)
        sides = random.integers(3, 9)
        angle = np.sort(random.uniform(0, 2 * math.pi, sides))
        radius = extent * random.uniform(0.5, 1, sides)
        outline = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)
        holes = [
            Hole(*(extent * random.uniform(-0.4, 0.4, 2)), extent * random.uniform(0.02, 0.3))
            for _ in range(random.integers(0, 3))
        ]
        if not shapely.Polygon(outline).is_valid:
            continue
        area = _without(shapely.Polygon(outline), holes, extent)
        starts = extent * random.uniform(-0.6, 0.6, (random.integers(0, 8), 2))
        cracks = _inside(area, [_line(random, start, extent * 0.5) for start in starts])
        if random.random() < 0.5:  # from a side inwards
            start = outline[0] + random.uniform(0.1, 0.9) * (outline[1] - outline[0])
            cracks += _inside(
                area.buffer(1e-6 * extent), [[tuple(start), tuple(random.uniform(0.3, 0.9) * start)]]
            )
        try:
            found.append((Plate([tuple(p) for p in outline], holes=holes, cracks=cracks), {}))
        except ValueError:
            continue
    return found


def _without(area, holes, extent):
    """An area without holes and what is close to them and to its edge."""
    for hole in holes:
        area = area.difference(shapely.Point(hole.x, hole.y).buffer(hole.radius + 1e-3 * extent))
    return area


def _inside(area, lines):
    return [CrackLine(line) for line in lines if area.contains(shapely.LineString(line))]


def _line(random, start, reach):
    """Corners of a line that bends a little."""
    place, heading, line = np.array(start, float), random.uniform(0, 2 * math.pi), [tuple(start)]
    for _ in range(random.integers(1, 4)):
        place = place + reach * random.uniform(0.1, 0.5) * np.array([math.cos(heading), math.sin(heading)])
        heading += random.uniform(-1, 1)
        line.append((float(place[0]), float(place[1])))
    return line
