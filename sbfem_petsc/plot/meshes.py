"""Picture of the discretisation: edges, nodes, scaling centres, contact pairs and named points."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.patches import Rectangle
from matplotlib.ticker import MaxNLocator
from matplotlib.transforms import ScaledTranslation

from meshing.boundary_mesh import BoundaryMesh
from meshing.gll import shape_functions

from ..record.units import place_unit
from .drawing import BLACK, BLUE, GREEN, MATERIAL, PURPLE, VERMILION, WIDTH, crack_title, dots, legend, note
from .picture import Comm, picture

OPEN, EDGE = "#FBE3C0", "#7F8C9A"


@picture(BoundaryMesh)
def plot_discretisation(mesh: BoundaryMesh | None, *, ax: Any = None, comm: Comm = None) -> list[Axes] | None:
    """Draw a boundary mesh: the whole structure, and two levels of zoom on each crack. Collective.

    Parameters
    ----------
    mesh : BoundaryMesh or None
        On rank 0 at least.
    ax : axes, sequence of axes, figure or subfigure of Matplotlib, optional
        What is drawn on; in one axes the whole structure alone. Default: a new figure.
    comm : mpi4py communicator, optional
        Default: MPI.COMM_WORLD.

    Returns
    -------
    Axes on rank 0, the whole structure first, None elsewhere; `save_picture` writes them
    """
    assert mesh is not None  # on rank 0
    lower, upper = mesh.nodes.min(axis=0), mesh.nodes.max(axis=0)
    extent = upper - lower
    stretch = max(1.0, 0.16 * extent[0] / extent[1])
    zoomed = mesh.cracks[:4]
    tall = (WIDTH - 0.8) * min(extent[1] / extent[0] * stretch, 1.2) + 0.75
    heights = [tall] + [3.45] * len(zoomed)
    layout = [["whole", "whole"]] + [[f"crack {k}", f"tip {k}"] for k in range(len(zoomed))]
    whole, *zooms = panels = ax.panels(layout, sum(heights) + 0.3, height_ratios=heights)
    margin = np.array([0.015, 0.2 if stretch > 1 else 0.07]) * extent
    _panel(whole, mesh, lower - margin, upper + margin, nodes=len(mesh.nodes) < 1500, stretch=stretch)
    facts = (
        f"{mesh.elements} S-elements of order {mesh.order}, {len(mesh.nodes)} nodes, {len(mesh.pairs)} "
        "contact pairs"
    )
    whole.set_title(facts + (f"; y stretched {stretch:.2g} times" if stretch > 1 else ""))
    for crack, around, at_tip in zip(zoomed, zooms[::2], zooms[1::2]):
        _draw_zooms(around, at_tip, mesh, crack)
    style: Any = {"markerscale": 1.6}
    if ax.figure is None:  # in the axes that were given
        legend(panels, loc="upper center", bbox_to_anchor=(0.5, -0.2), ncols=4, **style)
    else:
        style |= {"handletextpad": 0.3, "columnspacing": 1.2, "handlelength": 1.6}
        legend(panels, ax.figure, loc="outside lower center", ncols=7, **style)
    return panels


def _draw_zooms(around: Axes, at_tip: Axes, mesh: BoundaryMesh, crack: Any) -> None:
    """A crack, and its tip, framed in both."""
    tip = np.array(crack.tip)
    wide = 1.15 * crack.length
    # The element on the tip of a coarse mesh may be as large as the crack.
    near = min(4.5 * _tip_size(mesh, crack), 0.5 * wide)
    _panel(around, mesh, tip - wide, tip + wide, nodes=True)
    _panel(at_tip, mesh, tip - near, tip + near, nodes=True)
    around.set_title(crack_title(crack))
    at_tip.set_title(f"tip of {crack_title(crack)}")
    (left, right), (low, _) = at_tip.get_xlim(), at_tip.get_ylim()
    corner, side = (left, low), right - left
    around.add_patch(Rectangle(corner, side, side, fill=False, edgecolor=PURPLE, linewidth=0.8))
    for edge in at_tip.spines.values():
        edge.set_color(PURPLE)


def _tip_size(mesh, crack) -> float:
    """Extent of the S-element on a crack's tip; of the vertex layout, a fiftieth of the crack."""
    if crack.tip_element < 0:
        return 0.02 * crack.length
    return float(np.abs(mesh.nodes[mesh.element_nodes(crack.tip_element)] - np.array(crack.tip)).max())


def _panel(axes, mesh, lower: np.ndarray, upper: np.ndarray, nodes: bool, stretch: float = 1.0) -> None:
    """The part of the mesh in a window; places are told in one unit in all windows."""
    scale, unit = place_unit(float(np.ptp(mesh.nodes, axis=0).max()))
    values, _ = shape_functions(mesh.order, np.linspace(-1.0, 1.0, max(2 * mesh.order, 8) + 1))
    lines = values @ mesh.nodes[mesh.edges]
    seen = ((lines.max(axis=1) >= lower) & (lines.min(axis=1) <= upper)).all(axis=1)
    outer = np.isin(np.arange(len(seen)), mesh.outline_edges())
    sides = lines[mesh.element_edges]
    sides[mesh.element_reversed] = sides[mesh.element_reversed, ::-1]
    fills: dict[bool, list[np.ndarray]] = {True: [], False: []}
    faces = []
    for element in np.flatnonzero(np.logical_or.reduceat(seen[mesh.element_edges], mesh.element_start[:-1])):
        ring = sides[mesh.element_start[element] : mesh.element_start[element + 1]].reshape(-1, 2) * scale
        if not mesh.closed[element]:
            ring = np.vstack([ring, mesh.scaling_centres[element] * scale])
            faces += [ring[[0, -1]], ring[[-2, -1]]]
        fills[bool(mesh.closed[element])].append(ring)
    for rings, colour, label in ((fills[True], MATERIAL, None), (fills[False], OPEN, "open S-elements")):
        if rings:
            axes.add_collection(PolyCollection(rings, facecolors=colour, edgecolors="none", label=label))
    edges: Any = {"colors": EDGE, "linewidths": 0.5, "label": "edges of S-elements"}
    axes.add_collection(LineCollection(lines[seen & ~outer] * scale, **edges))
    edges |= {"colors": BLACK, "linewidths": 0.9, "label": "outline"}
    axes.add_collection(LineCollection(lines[seen & outer] * scale, **edges))
    axes.add_collection(LineCollection(faces, colors=BLACK, linewidths=0.9, linestyles=(0, (2, 1))))
    if nodes:
        size = 2.2 if stretch == 1.0 else 1.2
        dots(axes, mesh.nodes.T * scale, ".", size, BLUE, markeredgewidth=0, label="nodes")
    size = 4.5 if stretch == 1.0 else 2.8
    centres: Any = {"markeredgewidth": 0.7, "label": "scaling centres"}
    dots(axes, mesh.scaling_centres.T * scale, "+", size, VERMILION, **centres)
    if stretch == 1.0:
        _mark_pairs(axes, mesh, scale)
    _label_points(axes, mesh, lower, upper, scale)
    (left, low), (right, high) = lower * scale, upper * scale
    axes.set(xlim=(left, right), ylim=(low, high), aspect=stretch)
    axes.set(xlabel=f"x ({unit})", ylabel=f"y ({unit})" + (", stretched" if stretch > 1 else ""))
    for axis, most in ((axes.xaxis, 9 if stretch > 1.0 else 5), (axes.yaxis, 5)):
        axis.set_major_locator(MaxNLocator(most, steps=[1, 2, 5, 10]))


def _mark_pairs(axes: Axes, mesh: BoundaryMesh, scale: float) -> None:
    """Triangles that point at the other face. Faces micrometres apart coincide in the picture: the marks
    stand 2.5 points beside them, on their own side.
    """
    for crack in np.unique(mesh.pairs.crack):
        rows = mesh.pairs.crack == crack
        for side in (0, 1):
            outwards = (1 - 2 * side) * mesh.pairs.normal[rows][0]
            x, y = 2.5 / 72 * outwards
            beside = axes.transData + ScaledTranslation(x, y, axes.figure.dpi_scale_trans)
            triangle = (3, 0, np.degrees(np.arctan2(-outwards[1], -outwards[0])) - 90.0)
            style: Any = {"markeredgewidth": 0, "transform": beside, "label": "contact pairs"}
            dots(axes, mesh.nodes[mesh.pairs.nodes[rows, side]].T * scale, triangle, 3.4, GREEN, **style)


def _label_points(axes: Axes, mesh: BoundaryMesh, lower: np.ndarray, upper: np.ndarray, scale: float) -> None:
    """Named points; those that nearly coincide in the window share one label, above or below the point, where
    the material is not.
    """
    groups: dict[int, list[str]] = {}
    for name, node in mesh.points.items():
        at = mesh.nodes[node]
        if ((at >= lower) & (at <= upper)).all():
            near = (k for k in groups if (np.abs(at - mesh.nodes[k]) < 0.03 * (upper - lower)).all())
            groups.setdefault(next(near, node), []).append(name)
    for node, names in groups.items():
        at = mesh.nodes[node]
        style: Any = {"markerfacecolor": "white", "markeredgewidth": 0.8, "label": "named points"}
        dots(axes, at * scale, "o", 3.5, BLACK, **style)
        centred = at[0] < lower[0] + 0.9 * (upper[0] - lower[0])
        above = mesh.scaling_centres[np.abs(mesh.scaling_centres - at).sum(axis=1).argmin(), 1] <= at[1]
        style = {"ha": "center" if centred else "right", "va": "baseline" if above else "top"}
        style |= {"xytext": (0 if centred else -3, 4 if above else -4), "fontweight": "bold", "fontsize": 8}
        note(axes, ", ".join(names), at * scale, **style)
