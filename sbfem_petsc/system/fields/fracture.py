"""What cracks tell beside stress intensity factors: energy release rate, T-stress, contact pressure."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ...checks import shown
from ...errors import UnknownName, listed
from ...material import SectorMaterials
from ...petsc import MPI
from ...selement.fracture import energy_release_rate, interface_energy_release_rate, t_stress_row

if TYPE_CHECKING:
    from ..structure import Structure
    from .tip_faces import TipFaces

# Places along the faces inside a tip element at which the pressure is given, from the tip (0) to its
# boundary. Where the faces close a wedge, the pressure at the tip itself is infinite.
LEVELS = np.linspace(0.0, 1.0, 9)
NEXT_TO_TIP = 1e-3
# Exponents as close to 1/2 are a crack's as far as the contact next to its tip is concerned.
NEARLY_A_CRACK = 1e-2


def energy_release_rates(model: Structure, intensities: dict[str, tuple[float, float]]) -> dict[str, float]:
    """G of each tip, J/m^2; nan where it is none: at notches, and at tips that end at an interface.
    Collective.
    """
    values = np.zeros(len(intensities))
    factors = list(intensities.values())
    for number, group, _ in model.tip_places:
        if not model.tips.cracks[number]:
            values[number] = np.nan
            continue
        material = model.materials[group.material]
        if isinstance(material, SectorMaterials):
            values[number] = _at_interface(factors[number], material)
            continue
        axis = np.array(model.tip_elements[number].axis)
        values[number] = energy_release_rate(
            np.array(factors[number]), material.modulus * material.elasticity, axis
        )
    model.comm.Allreduce(MPI.IN_PLACE, values)
    return dict(zip(intensities, values.tolist()))


def unresolved_contact(
    model: Structure, intensities: dict[str, tuple[float, float]], force: np.ndarray
) -> dict[str, float]:
    """Resultant of the contact next to each tip at a wedge between the faces that pairs and pressure modes do
    not carry under forces (c,) of the contact rows, N. Collective.

    Where K_I < 0 is left, the faces overlap next to the tip, whatever the opening alpha between them. With
    contact they touch over the length ``c = 2 pi (K_I / (E' alpha))^2`` under the pressure ``E' alpha / (4
    pi) ln((1 + s) / (1 - s))``, s^2 = 1 - r / c, whose resultant is ``K_I^2 / (E' alpha)``: dislocations of
    the constant density alpha ahead of a crack that ends at c (Thomson 1986). That holds where c is small
    against the S-element at the tip, which is what pressure modes do not see. Where the contact ends inside
    it, some modes carry too little or, with K_I > 0 left, too much: that counts as negative. Where it ends
    beyond it, K_I is rounding. Faces that are tied close no wedge, and those with a layer between them have a
    K_I of their own.
    """
    values = np.zeros(len(intensities))
    factors = list(intensities.values())
    for number, group, _ in model.tip_places:
        tip, material = model.tip_elements[number], model.materials[group.material]
        first = factors[number][0]
        crack = abs(model.tips.exponents[number][0] - 0.5) < NEARLY_A_CRACK
        law = model.contact_laws[model.cracks[tip.crack].name]
        rigid = law.parts and not law.compliance
        at_tip, at_boundary = model.tip_gaps[number]
        wedge = at_tip == 0.0 and at_boundary > 0.0
        rows = force[model.tip_rows[number] : model.tip_rows[number + 1]]
        left = first < 0.0 or 0 < np.count_nonzero(rows) < len(rows)
        if not (rigid and wedge and left and crack and material.isotropic):
            continue
        shear = material.elasticity[2, 2]
        kappa = 1.0 + 2.0 * shear / (material.elasticity[0, 1] + shear)
        stiffness = 8.0 * shear / (kappa + 1.0) * material.modulus  # E'
        opening = at_boundary / abs(tip.arc[1] - tip.arc[0])
        values[number] = -first * abs(first) / (stiffness * opening) * model.thickness
    model.comm.Allreduce(MPI.IN_PLACE, values)
    return dict(zip(intensities, values.tolist()))


def _at_interface(intensity: tuple[float, float], material: SectorMaterials) -> float:
    """G of a crack along an interface of two isotropic materials; nan of others."""
    first, last = material.parts[0], material.parts[-1]
    change = [one != other for one, other in zip(material.parts, material.parts[1:])]
    if sum(change) != 1 or not (first.isotropic and last.isotropic):
        return np.nan
    return interface_energy_release_rate(
        np.array(intensity), np.stack([part.modulus * part.elasticity for part in (first, last)])
    )


def notes(model: Structure, force: np.ndarray, tip_forces: dict[int, np.ndarray]) -> tuple[str, ...]:
    """What K, G and T of the tips do not tell by themselves, in sentences. Collective.

    Parameters
    ----------
    force, tip_forces
        As of `t_stresses`.
    """
    tips = model.tips
    loaded = np.zeros(len(tips.names))
    for number, forces in tip_forces.items():
        loaded[number] = forces.any()
    pressed = (tips.touching(force) | (model.comm.allreduce(loaded) > 0.0)) & ~tips.interfaces
    found = tips.notes(force)
    if pressed.any():
        found += (
            f"t_stress of {listed(np.array(tips.names, dtype=object)[pressed])} is sigma_xx, beside the "
            "pressure p on the faces; sigma_xx - sigma_yy is T + p",
        )
    return found


class TStressForm(NamedTuple):
    """T of a tip as a linear form, Pa.

    Attributes
    ----------
    number : int
        Of the tip.
    nodes : (n,) int array
        This rank's nodes of its S-element.
    row : (n, 2) array
        For their displacements, m.
    faces : TipFaces or None
    columns : (modes,) array
        For the forces of its traction modes, N.
    """

    number: int
    nodes: np.ndarray
    row: np.ndarray
    faces: TipFaces | None
    columns: np.ndarray


def t_stress_forms(model: Structure) -> list[TStressForm]:
    """Those of the tips that this rank holds, but for open notches and interfaces, which have no T."""
    found = []
    tractions = {faces.number: faces for faces in model.tip_faces}
    for number, group, member in model.tip_places:
        material, rotation, size = (
            model.materials[group.material],
            group.rotations[member],
            float(group.sizes[member]),
        )
        if isinstance(material, SectorMaterials):
            continue
        axis = rotation @ np.array(model.tip_elements[number].axis)
        form = t_stress_row(group.solution.radial, group.shape, material.elasticity, axis)
        if np.isnan(form.row).any():
            continue
        faces, columns = tractions.get(number), np.zeros(0)
        if faces is not None:
            columns = form.of_tractions(faces.tractions) / (size * model.thickness)
        row = form.placed(rotation, size, material.modulus)
        found.append(TStressForm(number, group.nodes[member], row, faces, columns))
    return found


def t_stresses(
    model: Structure, field: np.ndarray, force: np.ndarray, tip_forces: dict[int, np.ndarray]
) -> dict[str, float]:
    """T of each tip, Pa; nan where there is none. Collective.

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
    values[[place.number for place in model.tip_places]] = np.nan
    for number, nodes, row, faces, columns in model.t_stress_forms:
        values[number] = float((row * field[nodes]).sum())
        if faces is not None:
            forces = faces.pressing(force)
            if number in tip_forces:
                forces += tip_forces[number][:, 0]
            acting = np.flatnonzero(forces)
            values[number] += float(columns[acting] @ forces[acting])
    model.comm.Allreduce(MPI.IN_PLACE, values)
    return {tip.name: float(value) for tip, value in zip(model.tip_elements, values)}


def contact_nodal_forces(model: Structure, force: np.ndarray) -> np.ndarray:
    """(m, 2): contact forces on this rank's nodes, also on those held fixed; sums over the ranks are the
    whole. Collective.
    """
    result = np.zeros((len(model.part.nodes), 2))
    pressing = model.pairs.normal * force[: len(model.pairs), None]
    if model.gap_operator.friction is not None:
        behind = force[len(model.gap_operator.laws) :][: len(model.pairs), None]
        pressing = pressing + model.pairs.normal[:, ::-1] * [1.0, -1.0] * behind
    for rows, sign in zip(model.pair_rows.T, (1.0, -1.0)):
        np.add.at(result, rows[rows >= 0], sign * pressing[rows >= 0])
    for faces in model.tip_faces:
        forces = faces.rows[: faces.modes].T @ force[faces.contact]
        if faces.rubbing >= 0:
            forces = faces.rows.T @ faces.pressing(force)
        np.add.at(result, faces.group.nodes[faces.member], forces.reshape(-1, 2))
    return result


def contact_pressure(
    model: Structure, force: np.ndarray, crack: str | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Positions along a crack (m from its first tip, as `arc` of its pairs) and contact pressure there (Pa),
    in order. Collective.

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
    chosen = np.flatnonzero(model.pairs.crack == number)
    position = [model.pairs.arc[chosen]]
    pressure = [force[chosen] / (model.pairs.weight[chosen] * model.thickness)]
    inside = []
    for faces in model.tip_faces:
        tip = model.tip_elements[faces.number]
        if tip.crack == number:
            levels = np.maximum(LEVELS, NEXT_TO_TIP) if faces.wedge else LEVELS
            tractions = faces.tractions.traction(faces.pressing(force), levels)[:, 0]
            place = tip.arc[0] + levels * (tip.arc[1] - tip.arc[0])
            inside.append((place, tractions / (faces.size * model.thickness)))
    for place, values in (found for part in model.comm.allgather(inside) for found in part):
        position.append(place)
        pressure.append(values)
    where, what = np.concatenate(position), np.concatenate(pressure)
    order = np.argsort(where, kind="stable")
    return where[order], what[order]
