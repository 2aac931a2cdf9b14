"""What cracks tell beside stress intensity factors: energy release rate, T-stress, contact pressure."""

from __future__ import annotations

import numpy as np

from ...checks import shown
from ...errors import UnknownName, listed
from ...material import SectorMaterials
from ...selement.fracture import energy_release_rate, interface_energy_release_rate
from ..contact.rows import Contact
from .sampling import Field
from .tip_faces import TipElement
from .tips import Tips

# Places along the faces inside a tip element at which the pressure is given, from the tip (0) to its
# boundary. Where the faces close a wedge, the pressure at the tip itself is infinite.
LEVELS = np.linspace(0.0, 1.0, 9)
NEXT_TO_TIP = 1e-3
# Exponents as close to 1/2 are a crack's as far as the contact next to its tip is concerned.
NEARLY_A_CRACK = 1e-2


def energy_release_rates(tips: Tips, intensities: dict[str, tuple[float, float]]) -> dict[str, float]:
    """G of each tip, J/m^2; nan where it is none: at notches, and at tips that end at an interface.
    Collective.
    """

    def rate(place: TipElement) -> float:
        factors, material = np.array(intensities[place.tip.name]), place.material
        if not tips.intensities.cracks[place.number]:
            return np.nan
        if isinstance(material, SectorMaterials):
            return _at_interface(factors, material)
        return energy_release_rate(factors, material.modulus * material.elasticity, np.array(place.tip.axis))

    return tips.told(rate)


def unresolved_contact(
    tips: Tips, intensities: dict[str, tuple[float, float]], force: np.ndarray
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

    def resultant(place: TipElement) -> float:
        number, tip, material = place.number, place.tip, place.material
        first = intensities[tip.name][0]
        crack = abs(tips.intensities.exponents[number][0] - 0.5) < NEARLY_A_CRACK
        law = tips.law_of(tip)
        rigid = law.parts and not law.compliance
        rows = force[tips.first_rows[number] : tips.first_rows[number + 1]]
        left = first < 0.0 or 0 < np.count_nonzero(rows) < len(rows)
        if not (rigid and tips.wedges[number] and left and crack and material.isotropic):
            return 0.0
        shear = material.elasticity[2, 2]
        kappa = 1.0 + 2.0 * shear / (material.elasticity[0, 1] + shear)
        stiffness = 8.0 * shear / (kappa + 1.0) * material.modulus  # E'
        opening = tips.gaps[number, 2] / abs(tip.arc[1] - tip.arc[0])
        return -first * abs(first) / (stiffness * opening) * tips.elements.thickness

    return tips.told(resultant)


def _at_interface(intensity: np.ndarray, material: SectorMaterials) -> float:
    """G of a crack along an interface of two isotropic materials; nan of others."""
    first, last = material.parts[0], material.parts[-1]
    change = [one != other for one, other in zip(material.parts, material.parts[1:])]
    if sum(change) != 1 or not (first.isotropic and last.isotropic):
        return np.nan
    return interface_energy_release_rate(
        intensity, np.stack([part.modulus * part.elasticity for part in (first, last)])
    )


def notes(tips: Tips, force: np.ndarray, tip_forces: dict[int, np.ndarray]) -> tuple[str, ...]:
    """What K, G and T of the tips do not tell by themselves, in sentences. Collective.

    Parameters
    ----------
    force : (c,) array
        Of the contact rows, N.
    tip_forces : dict of int to (modes, 1) array
        Of loads on the faces inside this rank's tip elements, N.
    """
    facts = tips.intensities
    loaded = np.zeros(len(facts.names))
    for number, forces in tip_forces.items():
        loaded[number] = forces.any()
    pressed = (facts.touching(force) | (tips.layout.comm.allreduce(loaded) > 0.0)) & ~facts.interfaces
    found = facts.notes(force)
    if pressed.any():
        found += (
            f"t_stress of {listed(np.array(facts.names, dtype=object)[pressed])} is sigma_xx, beside the "
            "pressure p on the faces; sigma_xx - sigma_yy is T + p",
        )
    return found


def t_stresses(tips: Tips, field: Field) -> dict[str, float]:
    """T of each tip, Pa; nan where there is none. Collective."""

    def stress(place: TipElement) -> float:
        if place.number not in tips.t_stress_forms:
            return np.nan
        row, columns = tips.t_stress_forms[place.number]
        forces = field.tip_forces.get(place.number, np.zeros(0))
        acting = np.flatnonzero(forces)
        return float((row * field.nodal[place.nodes]).sum()) + float(columns[acting] @ forces[acting])

    return tips.told(stress)


def contact_nodal_forces(contact: Contact, tips: Tips, force: np.ndarray) -> np.ndarray:
    """(m, 2): contact forces on this rank's nodes, also on those held fixed; sums over the ranks are the
    whole. Collective.
    """
    layout = tips.layout
    result = np.zeros((len(layout.part.nodes), 2))
    pressing = layout.pairs.normal * force[: contact.pairs, None]
    if contact.friction is not None:
        behind = force[len(contact.laws) :][: contact.pairs, None]
        pressing = pressing + layout.pairs.normal[:, ::-1] * [1.0, -1.0] * behind
    for rows, sign in zip(layout.pair_rows.T, (1.0, -1.0)):
        np.add.at(result, rows[rows >= 0], sign * pressing[rows >= 0])
    for faces in tips.faces.values():
        forces = faces.rows.T @ faces.pressing(force)
        np.add.at(result, faces.nodes, forces.reshape(-1, 2))
    return result


def contact_pressure(
    tips: Tips, force: np.ndarray, crack: str | None = None
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
    layout, thickness = tips.layout, tips.elements.thickness
    names = [item.name for item in layout.cracks]
    if crack is None and names:
        crack = names[0]
    if not isinstance(crack, str) or crack not in names:
        raise UnknownName(f"crack {shown(crack)} does not exist; the model has {listed(names)}")
    number = names.index(crack)
    chosen = np.flatnonzero(layout.pairs.crack == number)
    position = [layout.pairs.arc[chosen]]
    pressure = [force[chosen] / (layout.pairs.weight[chosen] * thickness)]
    inside = []
    for faces in tips.faces.values():
        tip = layout.tip_elements[faces.number]
        if tip.crack == number:
            levels = np.maximum(LEVELS, NEXT_TO_TIP) if faces.wedge else LEVELS
            tractions = faces.tractions.traction(faces.pressing(force), levels)[:, 0]
            place = tip.arc[0] + levels * (tip.arc[1] - tip.arc[0])
            inside.append((place, tractions / (faces.size * thickness)))
    for place, values in (found for part in layout.comm.allgather(inside) for found in part):
        position.append(place)
        pressure.append(values)
    where, what = np.concatenate(position), np.concatenate(pressure)
    order = np.argsort(where, kind="stable")
    return where[order], what[order]
