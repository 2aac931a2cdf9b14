"""What cracks tell beside stress intensity factors: energy release rate, T-stress, contact pressure."""

from __future__ import annotations

import numpy as np

from ..checks import shown
from ..errors import UnknownName, listed
from ..petsc import MPI
from ..selement.fracture import energy_release_rate, t_stress_row

# Instants along the faces inside a tip element at which the pressure is given, from the tip.
LEVELS = np.linspace(0.0, 1.0, 9)


def energy_release_rates(model, intensities: dict[str, tuple[float, float]]) -> dict[str, float]:
    """G of each tip, J/m^2. Collective."""
    values = np.zeros(len(intensities))
    factors = list(intensities.values())
    for number, group, _ in model.tip_places:
        exponents = model.tips.exponents[number]
        if not np.allclose(exponents, 0.5, atol=1e-6):
            values[number] = np.nan
            continue
        material = model.materials[group.material]
        axis = np.array(model.tip_elements[number].axis)
        values[number] = energy_release_rate(
            np.array(factors[number]), material.modulus * material.elasticity, axis
        )
    model.comm.Allreduce(MPI.IN_PLACE, values)
    return dict(zip(intensities, values.tolist()))


def t_stresses(
    model, field: np.ndarray, force: np.ndarray, tip_forces: dict[int, np.ndarray]
) -> dict[str, float]:
    """T of each tip, Pa. Collective.

    Parameters
    ----------
    field : (m, 2) array
        Displacements of this rank's nodes, m.
    force : (c,) array
        Of the contact rows, N.
    tip_forces : dict of int to (modes, 1) array
        Of loads on the faces inside this rank's tip elements, N.
    """
    values = np.zeros(len(model.tip_elements))
    tractions = {faces.number: faces for faces in model.tip_faces}
    for number, group, member in model.tip_places:
        material, rotation, size = (
            model.materials[group.material],
            group.rotations[member],
            float(group.sizes[member]),
        )
        axis = rotation @ np.array(model.tip_elements[number].axis)
        form = t_stress_row(group.solution.radial, group.shape, material.elasticity, axis)
        if np.isnan(form.row).any():
            values[number] = np.nan
            continue
        row = form.placed(rotation, size, material.modulus)
        values[number] = float((row * field[group.nodes[member]]).sum())
        faces = tractions.get(number)
        if faces is not None:
            first = model.gap_operator.pairs + faces.modes * number
            forces = np.zeros(len(faces.tractions.powers))
            forces[: faces.modes] = force[first : first + faces.modes]
            if number in tip_forces:
                forces += tip_forces[number][:, 0]
            if forces.any():
                values[number] += float(form.of_tractions(faces.tractions) @ forces) / (
                    size * model.thickness
                )
    model.comm.Allreduce(MPI.IN_PLACE, values)
    return {tip.name: float(value) for tip, value in zip(model.tip_elements, values)}


def contact_nodal_forces(model, force: np.ndarray) -> np.ndarray:
    """(m, 2): contact forces on this rank's nodes, also on those held fixed; sums over the ranks are the
    whole.
    """
    result = np.zeros((len(model.part.nodes), 2))
    gap = model.gap_operator
    if model.comm.rank == 0:
        mine = model.part.nodes
        for (right, left), normal, value in zip(model.pairs.nodes, model.pairs.normal, force):
            for node, sign in ((right, 1.0), (left, -1.0)):
                row = np.searchsorted(mine, node)
                if value and row < len(mine) and mine[row] == node:
                    result[row] += sign * value * normal
    for faces in model.tip_faces:
        first = gap.pairs + faces.modes * faces.number
        forces = faces.rows[: faces.modes].T @ force[first : first + faces.modes]
        np.add.at(result, faces.group.nodes[faces.member], forces.reshape(-1, 2))
    return result


def contact_pressure(model, force: np.ndarray, crack: str | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Positions along a crack (m from its first tip) and contact pressure there (Pa), in order. Collective.

    Parameters
    ----------
    force : (c,) array
        Of the contact rows, N.
    crack : str, optional
        Default: the first one.

    Raises
    ------
    UnknownName
        If there is no such crack.
    """
    names = [item.name for item in model.cracks]
    if crack is None and names:
        crack = names[0]
    if not isinstance(crack, str) or crack not in names:
        raise UnknownName(f"crack {shown(crack)} does not exist; the model has {listed(names)}")
    number = names.index(crack)
    chosen = np.flatnonzero((model.pairs.crack == number) & (model.pairs.weight > 0.0))
    position = [model.pairs.arc[chosen]]
    pressure = [force[chosen] / (model.pairs.weight[chosen] * model.thickness)]
    length = float(model.cracks[number].length)
    for tip_number, tip in enumerate(model.tip_elements):
        if tip.crack != number:
            continue
        found = [
            (faces.size * faces.tractions.lengths[0], _mode_pressure(model, faces, force))
            for faces in model.tip_faces
            if faces.number == tip_number
        ]
        everywhere = [item for part in model.comm.allgather(found) for item in part]
        if everywhere:
            reach, values = everywhere[0]
            arc = LEVELS * reach
            near_start = len(chosen) == 0 or tip_is_start(model, tip, chosen)
            position.append(arc if near_start else length - arc)
            pressure.append(values)
    where, what = np.concatenate(position), np.concatenate(pressure)
    order = np.argsort(where, kind="stable")
    return where[order], what[order]


def tip_is_start(model, tip, chosen: np.ndarray) -> bool:
    """Whether the arc length of a crack's pairs begins at a tip."""
    tips = [other for other in model.tip_elements if other.crack == tip.crack]
    if len(tips) < 2:
        return True
    return bool(tip.name.endswith(":1"))


def _mode_pressure(model, faces, force: np.ndarray) -> np.ndarray:
    first = model.gap_operator.pairs + faces.modes * faces.number
    forces = np.zeros(len(faces.tractions.powers))
    forces[: faces.modes] = force[first : first + faces.modes]
    return faces.tractions.traction(forces, LEVELS)[:, 0] / (faces.size * model.thickness)
