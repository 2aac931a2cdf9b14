"""What a boundary mesh holds, as a text to check a model by."""

from __future__ import annotations

import math

import numpy as np

from meshing.gll import gll_nodes, lagrange_slopes
from meshing.mesh_arrays import MeshArrays


def edge_lengths(mesh: MeshArrays) -> np.ndarray:
    """Lengths of the polynomial edges, m, (n_edges,)."""
    at, weight = np.polynomial.legendre.leggauss(mesh.order + 2)
    tangents = lagrange_slopes(gll_nodes(mesh.order), at) @ mesh.nodes[mesh.edges]
    return np.hypot(tangents[..., 0], tangents[..., 1]) @ weight


def summary(mesh: MeshArrays) -> str:
    """Extent, S-elements, unknowns, materials, edge sets, points, cracks with their tips and pairs.

    Parameters
    ----------
    mesh : BoundaryMesh

    Returns
    -------
    str
        Several lines, lengths in m, angles in degrees.
    """
    lengths = edge_lengths(mesh)
    (left, bottom), (right, top) = mesh.nodes.min(axis=0), mesh.nodes.max(axis=0)
    outline = mesh.outline_edges()
    lines = [
        f"extent      {right - left:.6g} x {top - bottom:.6g} m: x {left:.6g} to {right:.6g}, y {bottom:.6g} "
        f"to {top:.6g}; area {mesh.area:.6g} m2",
        f"mesh        {mesh.elements} S-elements of order {mesh.order}, {len(mesh.edges)} edges of "
        f"{lengths.min():.3g} to {lengths.max():.3g} m",
        f"unknowns    {2 * len(mesh.nodes)} displacements of {len(mesh.nodes)} nodes, before supports",
    ]
    counts = np.bincount(mesh.materials, minlength=len(mesh.material_names))
    for name, count in zip(mesh.material_names, counts):
        lines.append(f"material    {name}: {count} S-elements")
    for name, edges in mesh.edge_sets.items():
        edges = np.asarray(edges)
        inside = int((~np.isin(edges, outline)).sum())
        where = f", {inside} of them inside the body" if inside else ""
        lines.append(f"edge set    {name}: {lengths[edges].sum():.6g} m in {len(edges)} edges{where}")
    for name, node in mesh.points.items():
        x, y = mesh.nodes[node]
        lines.append(f"point       {name}: ({x:.6g}, {y:.6g}) m")
    for number, crack in enumerate(mesh.cracks):
        gaps = mesh.pairs.gap[mesh.pairs.crack == number]
        tips = [tip for tip in mesh.tips if tip.crack == number]
        faces = f", gaps {gaps.min():.3g} to {gaps.max():.3g} m" if len(gaps) else ""
        lines.append(
            f"crack       {crack.name}: length {crack.length:.6g} m, {_counted(len(tips), 'tip')}, "
            f"{_counted(len(gaps), 'contact pair')}{faces}"
        )
        for tip in tips:
            x, y = tip.position
            element = f"S-element {tip.element}" if tip.element >= 0 else "no S-element of its own"
            if tip.element in mesh.sector_materials:
                meeting = dict.fromkeys(mesh.sector_materials[tip.element].tolist())
                element += " in " + " and ".join(mesh.material_names[k] for k in meeting)
            lines.append(
                f"  tip       {tip.name}: ({x:.6g}, {y:.6g}) m, opening {math.degrees(tip.opening):.4g} deg, "
                f"{element}"
            )
    if not mesh.cracks:
        lines.append("crack       none")
    return "\n".join(lines)


def _counted(count: int, what: str) -> str:
    return f"{count} {what}" if count == 1 else f"{count or 'no'} {what}s"
