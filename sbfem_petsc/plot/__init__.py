"""Pictures of results: every function returns matplotlib's axes, and `save_picture` writes them."""

try:
    import matplotlib  # noqa: F401 - the one place that says what is missing
except ImportError as error:  # pragma: no cover - depends on the machine
    raise ImportError(
        f"pictures need matplotlib ({error}); install it with `pip install 'sbfem-petsc[plot]'`"
    ) from error

from .animation import animate_crack
from .basins import plot_basins
from .branches import plot_branches
from .crack import plot_crack
from .detection import plot_detection
from .drawing import save_picture, save_pictures
from .fields import plot_contact, plot_modes
from .histories import Panel, plot_histories, plot_history, plot_load_history, plot_spectra
from .loci import plot_loci
from .meshes import plot_discretisation
from .orbits import plot_harmonics, plot_multipliers, plot_orbit
from .sweeps import plot_swept
from .tones import plot_backbone, plot_lines, plot_sidebands
from .tori import plot_quasi_periodic

__all__ = [
    "Panel",
    "animate_crack",
    "plot_backbone",
    "plot_basins",
    "plot_branches",
    "plot_contact",
    "plot_crack",
    "plot_detection",
    "plot_discretisation",
    "plot_harmonics",
    "plot_histories",
    "plot_history",
    "plot_loci",
    "plot_lines",
    "plot_load_history",
    "plot_modes",
    "plot_multipliers",
    "plot_orbit",
    "plot_quasi_periodic",
    "plot_sidebands",
    "plot_spectra",
    "plot_swept",
    "save_picture",
    "save_pictures",
]
