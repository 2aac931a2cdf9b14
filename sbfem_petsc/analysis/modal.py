"""Natural frequencies and mode shapes of the structure with open cracks, by SLEPc (prefix ``modal_``)."""

from __future__ import annotations

from dataclasses import field, replace
from typing import overload

import numpy as np

from ..bodies.finite_element_model import FiniteElementModel
from ..checks import instance, integer
from ..errors import SolveError, at_point, listed, warn, wrong_input
from ..record.record import Record, described, quantity
from ..reduction.reduced_model import SYSTEM, ReducedModel, require_rows
from ..system.fields.resolution import warn_of_modes
from ..system.model import Model
from ..system.solve.modal_result import Modal
from ..system.solve.modes import TOLERANCE, lowest_modes, modes_in_band
from .analysis import analysis
from .estimate import Sought, refined
from .options import ModalOptions

# Frequencies below, relative to the highest, are rigid-body motions and round-off.
RIGID = 1e-5
# Frequencies that are printed.
SHOWN = 6


@described
class ReducedModal(Record):
    """Modes that a reduced model of a body or of matrices keeps, lowest first, mass-normalised."""

    frequencies: np.ndarray = quantity("Hz", "natural frequencies, open contact", "mode", least=0.0, row=True)
    damping: np.ndarray = quantity("1", "modal damping ratios", "mode", least=0.0)
    point_shapes: dict[str, np.ndarray] = quantity(
        "1/sqrt(kg)",
        "displacement along the own direction of each point in each mode",
        "mode place",
        called="displacement",
        by="place",
    )
    directions: dict[str, str] = quantity(
        text="directions of the points of a body", dims="place", kinds="U", default_factory=dict
    )
    body: FiniteElementModel | None = field(default=None, repr=False)
    shapes: np.ndarray | None = field(default=None, repr=False)

    def displacement(self, point: str) -> np.ndarray:
        """(n,): of a named point in each mode, along its own direction."""
        return at_point(self.point_shapes, point)

    def nodal(self, mode: int) -> np.ndarray:
        """(nodes, 3): a mode of a body, 0 the lowest, at all nodes in the order of `body.labels`.

        Raises
        ------
        SolveError
            If the shapes are not kept.
        """
        if self.body is None or self.shapes is None:
            raise SolveError("nodal: the modes are read from a file, or those of a model that kept no shapes")
        most = len(self.frequencies) - 1
        return self.body.nodal(self.shapes[:, integer("nodal", "mode", mode, least=0, most=most)])

    def __repr__(self) -> str:
        shown = ", ".join(f"{f:.6g}" for f in self.frequencies[:SHOWN])
        return (
            f"ReducedModal({len(self.frequencies)} frequencies: "
            f"{shown}{', ...' * (len(self.frequencies) > SHOWN)} Hz)"
        )


@overload
def modal(
    model: Model,
    count: int | None = None,
    band: tuple[float, float] | None = None,
    *,
    auxiliary_tolerance: float = TOLERANCE,
    verify: bool = True,
    accuracy: float | None = None,
) -> Modal: ...
@overload
def modal(
    model: ReducedModel, count: int | None = None, band: tuple[float, float] | None = None
) -> ReducedModal: ...
@analysis(ModalOptions, rubs=True)
def modal(
    model: Model | ReducedModel,
    count: int | None = None,
    band: tuple[float, float] | None = None,
    *,
    auxiliary_tolerance: float = TOLERANCE,
    verify: bool = True,
    accuracy: float | None = None,
) -> Modal | ReducedModal:
    """Natural frequencies of the undamped structure, cracks open, no contact; tied ones are open too.

    Parameters
    ----------
    model : Model or ReducedModel
        A reduced one of a body or of matrices: of the modes that it keeps, without further options.
    count : int, optional
        Number of lowest frequencies (rigid-body modes of a free structure included).
    band : (low, high), optional
        All frequencies in this band, Hz. Give either `count` or `band`.
    auxiliary_tolerance : float
        Auxiliary unknowns of the continued fraction that contribute less to their S-element are left out, see
        `Pencil`. On the paper's beam (46 frequencies) 1e-4 moves a frequency by 2e-7 at most, 1e-5 by 3e-8; 0
        keeps all.
    verify : bool
        Count the eigenvalues by the inertia of one more factorisation (where MUMPS is there), so that none of
        a multiple one is missed.
    accuracy : float, optional
        Relative error asked for of every frequency: finer meshes are made, as by `estimate`, until two of
        them agree. The result is the finest one's, `Modal.model` its model, `Modal.estimate` says what was
        used. Default: the model's own mesh alone.

    Returns
    -------
    Modal or ReducedModal

    Raises
    ------
    ValueError
        If neither or both are given, or a value makes no sense; of a reduced model more than it keeps.
    SolveError
        If SLEPc does not converge or a residual is too large.

    Warns
    -----
    UserWarning
        If a crack's law is `Tied`.
    MeshWarning
        If one of the highest frequencies is off by more than 7e-4 because cells are long for its waves; if
        the accuracy asked for is not reached.
    """
    if isinstance(model, ReducedModel):
        if accuracy is not None:
            raise ValueError("modal: accuracy is of a Model, whose mesh can be made finer; leave it out")
        return _kept_modes(model, count, band)
    instance("modal", "model", model, Model, SYSTEM)
    most = model.boundary_unknowns // 2
    if count is not None and count > most:
        raise wrong_input(
            f"modal: count = {count} must be between 1 and half the number of boundary unknowns ({most})"
        )
    tied = [name for name, law in model.contact_laws.items() if not law.parts]
    if tied:
        warn(
            f"modal: the cracks {listed(tied)} are tied, but modes are those of open cracks; for a body "
            "without them leave them out of the geometry",
            UserWarning,
        )

    def solve(level: Model) -> Modal:
        if band is not None:
            return modes_in_band(level, band, auxiliary_tolerance, verify)
        assert count is not None
        usual = auxiliary_tolerance == TOLERANCE and verify
        if usual:
            return level.modes(count)
        return lowest_modes(level, count, auxiliary_tolerance, verify)

    if accuracy is None:
        found = solve(model)
        warn_of_modes("modal", found)
        return found
    _, found, estimate = refined("modal", Sought(solve, _elastic_frequencies), model, accuracy=accuracy)
    return replace(found, estimate=estimate)


def _kept_modes(reduced: ReducedModel, count: int | None, band: tuple[float, float] | None) -> ReducedModal:
    """Those of a number or of a band in Hz, of the modes that are kept."""
    require_rows("modal", reduced)
    f = reduced.frequencies
    if count is not None and count > len(f):
        raise ValueError(
            f"modal: count = {count} is more than the {len(f)} modes of the reduced model; keep more"
        )
    if band is not None and band[1] > f[-1]:
        raise ValueError(
            f"modal: band = {band} goes beyond {f[-1]:.6g} Hz, where the modes of the reduced model end; "
            "reduce it with more"
        )
    keep = np.arange(len(f))[:count] if band is None else np.flatnonzero((f >= band[0]) & (f <= band[1]))
    shapes = {name: reduced.points.modes[k, -1, keep] for k, name in enumerate(reduced.points.names)}
    whole = None if reduced.whole is None else reduced.whole.modes[:, keep]
    facts = f[keep], reduced.damping[keep], shapes, reduced.point_directions
    return ReducedModal(*facts, reduced.body, whole)


def _elastic_frequencies(found: Modal) -> np.ndarray:
    """Those of the modes that are not rigid-body motions, Hz."""
    return found.frequencies[found.frequencies > RIGID * found.frequencies.max(initial=0.0)]
