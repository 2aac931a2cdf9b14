"""Natural frequencies and mode shapes of the structure with open cracks, by SLEPc (prefix ``modal_``)."""

from __future__ import annotations

from ..checks import flag, integer, numbers_of, real, shown
from ..parallel import agree, collective
from ..system.model import Model
from ..system.modes import TOLERANCE, Modal, lowest_modes, modes_in_band
from ..system.resolution import warn_of_modes

# No structure has a frequency beyond, Hz.
HIGHEST = 1e30


def modal(
    model: Model,
    count: int | None = None,
    band: tuple[float, float] | None = None,
    *,
    auxiliary_tolerance: float = TOLERANCE,
    verify: bool = True,
) -> Modal:
    """Natural frequencies of the undamped structure, cracks open, no contact.

    Parameters
    ----------
    model : Model
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

    Returns
    -------
    Modal

    Raises
    ------
    ValueError
        If neither or both are given, or a value makes no sense.
    SolveError
        If SLEPc does not converge or a residual is too large.

    Warns
    -----
    MeshWarning
        If one of the highest frequencies is off by more than 7e-4 because cells are long for its waves.
    """
    if not isinstance(model, Model):
        raise TypeError(f"modal: model = {shown(model)} is not a Model")
    with collective(model.comm):
        band = _checked_request(model, count, band, auxiliary_tolerance, verify)
    agree(model.comm, "modal", count=count, band=band, auxiliary_tolerance=auxiliary_tolerance, verify=verify)
    if band is not None:
        found = modes_in_band(model, *band, auxiliary_tolerance, verify)
    else:
        assert count is not None
        usual = auxiliary_tolerance == TOLERANCE and verify
        found = model.modes(count) if usual else lowest_modes(model, count, auxiliary_tolerance, verify)
    warn_of_modes("modal", found)
    return found


def _checked_request(model: Model, count, band, auxiliary_tolerance, verify) -> tuple[float, float] | None:
    """The band, if one was given."""
    real("modal", "auxiliary_tolerance", auxiliary_tolerance, least=0.0, below=1.0)
    flag("modal", "verify", verify)
    if (count is None) == (band is None):
        raise ValueError(f"modal: give either count or band (count = {count!r}, band = {band!r})")
    if count is not None:
        integer("modal", "count", count)
        if not 1 <= count <= model.boundary_unknowns // 2:
            raise ValueError(
                f"modal: count = {shown(count)} must be between 1 and half the number of boundary unknowns "
                f"({model.boundary_unknowns // 2})"
            )
        return None
    wanted = "two frequencies 0 <= low < high in Hz"
    low, high = numbers_of("modal", "band", band, 2, wanted, least=0.0, most=HIGHEST)
    if not low < high:
        raise ValueError(f"modal: band = {shown(band)} must be {wanted}")
    return low, high
