"""Pictures of results: every function returns matplotlib's axes, and `save_picture` writes them."""

from __future__ import annotations

from meshing.lazily import loaded

from ..working_directory import unread

try:
    with unread("matplotlibrc", "matplotlib"):
        import matplotlib  # noqa: F401 - the one place that says what is missing
except ImportError as error:  # pragma: no cover - depends on the machine
    raise ImportError(
        f"pictures need matplotlib ({error}); install it with `pip install 'sbfem-petsc[plot]'`"
    ) from error

# Public names by the module they stand in.
_HOME = {
    "animation": ("animate_crack",),
    "branches": ("plot_backbone", "plot_branches", "plot_quasi_periodic"),
    "drawing": ("save_picture", "save_pictures"),
    "fields": ("plot_contact", "plot_crack", "plot_field", "plot_modes"),
    "histories": ("Panel", "plot_histories", "plot_history", "plot_load_history", "plot_spectra"),
    "lines": ("plot_harmonics", "plot_lines", "plot_sidebands"),
    "maps": ("plot_basins", "plot_detection"),
    "meshes": ("plot_discretisation",),
    "orbits": ("plot_multipliers", "plot_orbit"),
    "rubbing": ("plot_friction_power", "plot_hysteresis", "plot_losses", "plot_slips"),
    "sweeps": ("plot_loci", "plot_swept"),
}
__all__ = sorted(name for names in _HOME.values() for name in names)

__getattr__, __dir__ = loaded(__name__, _HOME)
