"""Interior fields of this rank's S-elements at graded points, for files and pictures."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import DTypeLike

from meshing.gll import shape_functions

from ...checks import real_array
from ...material import AnyMaterial, Material, SectorMaterials
from ...ranks.parallel import collective
from ...selement.coefficients import edge_nodes
from ...selement.face_tractions import FaceTractions
from ...selement.interior import Located, fields_at, in_own_frames, static_fields
from ...selement.sectors import Sectors
from ..elements.shapes import Group
from ..layout.layout import Layout
from ..loads import LoadColumns
from .tip_faces import TipFaces
from .tips import Tips

# xi of the innermost ring of points. The stress shown at the scaling centre is that at xi = CENTRE: at a
# crack tip, where it has no bound, the innermost ring's; elsewhere all directions agree there within a
# percent of its variation.
INNERMOST_CLOSED, INNERMOST_OPEN, CENTRE = 0.25, 0.01, 0.01
# S-elements of one shape that are sampled at a time.
_TOGETHER = 256


@dataclass(frozen=True, eq=False)
class Field:
    """A displacement field: what determines it inside the S-elements of this rank.

    Attributes
    ----------
    nodal : (m, 2) array
        Displacements of this rank's nodes, m.
    tip_forces : dict of int to (modes,) array
        Forces of all traction modes on the faces inside tip elements, N, by the tip's number; without
        an entry these faces are free.
    """

    nodal: np.ndarray
    tip_forces: Mapping[int, np.ndarray] = field(default_factory=dict)

    def __array__(self, dtype: DTypeLike | None = None) -> np.ndarray:
        """The nodal displacements, for NumPy."""
        return np.asarray(self.nodal, dtype=dtype)

    @classmethod
    def of_forces(cls, tips: Tips, nodal: np.ndarray, force: np.ndarray, load: LoadColumns) -> Field:
        """With the forces of the contact rows (c,), N, and one column of loads on the faces inside tip
        elements.
        """
        forces = {number: faces.pressing(force) for number, faces in tips.faces.items()}
        for number, acting in load.tip_forces.items():
            forces[number] += acting[:, 0]
        return cls(nodal, forces)


def as_field(state: Any, name: str = "of displacements") -> Field:
    """Of a `Field`, a result that has one as `.interior`, or nodal displacements; named in an error."""
    state = getattr(state, "interior", state)
    return state if isinstance(state, Field) else Field(real_array("fields", repr(name), state, 2, "m"))


@dataclass(frozen=True, eq=False)
class Patches:
    """Points of k S-elements of one shape: l levels from the boundary inwards, the last one the scaling
    centre.

    Attributes
    ----------
    elements : (k,) int array
        Rows of the rank's part.
    mirrored : (k,) bool array
        Whether the edges, of the mirrored reference shape, run clockwise.
    material : int
        See `Elements.named_materials`.
    positions : (k, l, edges, q, 2) array
        m.
    displacements : dict of str to (k, l, edges, q, 2) array
        m.
    stresses : dict of str to (k, l, edges, q, 4) array
        xx, yy, xy and von Mises, Pa; at the scaling centre those at xi = `CENTRE`.
    """

    elements: np.ndarray
    mirrored: np.ndarray
    material: int
    positions: np.ndarray
    displacements: dict[str, np.ndarray]
    stresses: dict[str, np.ndarray]


def graded_levels(closed: bool, finest: float, refine: int = 1) -> np.ndarray:
    """xi from 1 to the innermost ring of points.

    Parameters
    ----------
    closed : bool
        Geometric steps towards the scaling centre in open S-elements (a crack tip), else even ones.
    finest : float
        Length of the shortest edge in units of the S-element's size: where edges are graded towards a point
        of the boundary of a closed S-element, the levels are graded towards the boundary.
    refine : int
        Levels of open S-elements for each default one.
    """
    if not closed:
        return np.geomspace(1.0, INNERMOST_OPEN, 8 * refine + 1)
    depth = 1.0 - INNERMOST_CLOSED
    if finest > 0.1:
        return np.linspace(1.0, INNERMOST_CLOSED, 4)
    steps = int(np.ceil(np.log2(depth / finest))) + 1
    return 1.0 - np.append(0.0, np.geomspace(finest, depth, steps))


def sample(
    tips: Tips,
    fields: Mapping[str, Any],
    subdivisions: int | None = None,
    stress: bool = True,
    keep: np.ndarray | None = None,
    refine: int = 1,
) -> list[Patches]:
    """Sample nodal displacement fields inside the S-elements of this rank. Collective.

    Parameters
    ----------
    tips : Tips
    fields : dict of str to Static, Field or (m, 2) array
        An array holds displacements of this rank's nodes, m (rows as in ``Layout.part.nodes``).
    subdivisions : int, optional
        Straight pieces an edge is drawn with; default: the order of the edges.
    stress : bool
        Whether stresses are evaluated.
    keep : (e,) bool array, optional
        S-elements of the rank's part to sample; default: all.
    refine : int
        Levels of open S-elements for each default one.
    """
    elements, layout, loaded = tips.elements, tips.layout, tips.faces
    with collective(layout.comm):
        states = {name: as_field(state, name) for name, state in fields.items()}
        for name, state in states.items():
            if state.nodal.shape != layout.part.coordinates.shape:
                raise ValueError(
                    f"field {name!r} has shape {state.nodal.shape}; displacements of this rank's nodes have "
                    f"shape {layout.part.coordinates.shape}"
                )
    at = np.linspace(-1.0, 1.0, (layout.order if subdivisions is None else subdivisions) + 1)
    chosen = (
        group if keep is None else group.select(np.flatnonzero(keep[group.elements]))
        for group in elements.groups
    )
    patches = []
    for group in (
        g.select(slice(k, k + _TOGETHER)) for g in chosen for k in range(0, len(g.sizes), _TOGETHER)
    ):
        material, radial = elements.materials[group.material], group.solution.radial
        edges = edge_nodes(len(group.shape), group.order, group.closed)
        ends = group.shape[edges][:, [0, -1]]
        levels = graded_levels(
            group.closed, float(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1).min()), refine
        )
        shown, near = np.append(levels, 0.0), np.append(levels, CENTRE)
        grid = np.meshgrid(np.arange(len(shown)), np.arange(len(edges)), at, indexing="ij")
        which, edge, eta = (axis.ravel() for axis in grid)
        located = Located(edge, eta, shown[which])
        size, sectors = (
            (len(group.sizes), *grid[0].shape, -1),
            Sectors(group.shape, group.order, material.elasticity),
        )
        outline = shape_functions(group.order, at)[0] @ group.shape[edges]
        positions = np.einsum("k,l,eqi,kij->kleqj", group.sizes, shown, outline, group.rotations)
        positions += layout.part.centres[group.elements][:, None, None, None]
        displacements, stresses = {}, {}
        for name, state in states.items():
            faces = None if group.closed else _loaded_faces(loaded, group, state)
            columns = np.einsum("kij,knj->nik", group.rotations, state.nodal[group.nodes])
            inside = static_fields(radial, columns.reshape(len(radial), -1), shown, near, faces)
            moved, plane = in_own_frames(
                *fields_at(sectors, group.closed, located, inside, which), group.rotations
            )
            displacements[name] = moved.reshape(size)
            if stress:
                plane = (plane * (material.modulus / group.sizes)[:, None, None]).reshape(size)
                stresses[name] = np.concatenate([plane, von_mises(plane, material)[..., None]], axis=-1)
        patches.append(
            Patches(
                group.elements,
                np.linalg.det(group.rotations) < 0.0,
                group.material,
                positions,
                displacements,
                stresses,
            )
        )
    return patches


def _loaded_faces(
    loaded: Mapping[int, TipFaces], group: Group, state: Field
) -> tuple[FaceTractions, np.ndarray] | None:
    """Traction modes on the faces of open S-elements of one shape, and their forces (modes, k) over E and
    the thickness, m.
    """
    if not state.tip_forces:
        return None
    rows = {int(element): k for k, element in enumerate(group.elements)}
    forces, tractions = None, None
    for number, faces in loaded.items():
        k = rows.get(int(faces.group.elements[faces.member]))
        if k is None or number not in state.tip_forces:
            continue
        if forces is None:
            tractions, forces = faces.tractions, np.zeros((len(faces.tractions.growth), len(rows)))
        forces[:, k] = state.tip_forces[number] / faces.stiffness
    return None if tractions is None or forces is None else (tractions, forces)


def von_mises(stress: np.ndarray, material: AnyMaterial) -> np.ndarray:
    """Von Mises stress (...,) from (xx, yy, xy) (..., 3), with the stress normal to the plane in plane
    strain.
    """
    xx, yy, xy = np.moveaxis(stress, -1, 0)
    zz = (stress * normal_stress_row(material)).sum(axis=-1)
    return np.sqrt(0.5 * ((xx - yy) ** 2 + (yy - zz) ** 2 + (zz - xx) ** 2) + 3.0 * xy**2)


def normal_stress_row(material: AnyMaterial) -> np.ndarray:
    """(3,): sigma_zz as a linear form of (xx, yy, xy); zero in plane stress. (edges, 1, 3) of sectors."""
    if isinstance(material, SectorMaterials):
        return np.stack([normal_stress_row(part)[None] for part in material.parts])
    if isinstance(material, Material):
        return (material.plane == "strain") * np.array([material.poisson, material.poisson, 0.0])
    compliance = material.compliance()
    first, second = -compliance[2, :2] / compliance[2, 2]  # of sigma_11, sigma_22
    c, s = np.cos(np.radians(material.angle)), np.sin(np.radians(material.angle))
    return np.array(
        [first * c * c + second * s * s, first * s * s + second * c * c, 2.0 * c * s * (first - second)]
    )


def point_grid_cells(patches: Patches) -> tuple[np.ndarray, np.ndarray]:
    """Counter-clockwise cells between the points of a patch, numbered as its positions are flattened.

    Returns
    -------
    quadrilaterals : (k, rings * edges * pieces, 4) int array
    triangles : (k, edges * pieces, 3) int array
        Those at the scaling centre.
    """
    count, depth, edges, points, _ = patches.positions.shape
    numbers = np.arange(count * depth * edges * points).reshape(count, depth, edges, points)
    outer, inner = numbers[:, :-2], numbers[:, 1:-1]
    quadrilaterals = np.stack([outer[..., :-1], outer[..., 1:], inner[..., 1:], inner[..., :-1]], axis=-1)
    ring, centre = numbers[:, -2], numbers[:, -1]
    triangles = np.stack([ring[..., :-1], ring[..., 1:], centre[..., :-1]], axis=-1)
    quadrilaterals[patches.mirrored] = quadrilaterals[patches.mirrored, ..., ::-1]
    triangles[patches.mirrored] = triangles[patches.mirrored, ..., ::-1]
    return quadrilaterals.reshape(count, -1, 4), triangles.reshape(count, -1, 3)


def outline_edges(layout: Layout, chain: int) -> np.ndarray:
    """(edges, order + 1): nodes of each edge of S-element `chain` of this rank, as rows of the part's
    nodes.
    """
    nodes = layout.part.chains[chain]
    return nodes[edge_nodes(len(nodes), layout.order, bool(layout.part.closed[chain]))]
