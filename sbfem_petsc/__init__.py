"""sbfem-petsc: scaled boundary finite elements with unilateral crack contact on PETSc and SLEPc.

Names are loaded when first used, so that a program can read its command line and hand PETSc's options over
(`sbfem_petsc.command_line`) before PETSc starts.
"""

from __future__ import annotations

import importlib.util
import os

# A file or folder of the user's own may have this name, and stands before the package beside this one.
_found = importlib.util.find_spec("meshing")
_places = list(_found.submodule_search_locations or ()) if _found else []
if not any(os.path.isfile(os.path.join(place, "boundary_mesh.py")) for place in _places):
    raise ImportError(
        f"{(_found.origin if _found else None) or _places or 'nothing'} is found where sbfem_petsc looks for "
        "its package meshing; give it another name, or install sbfem_petsc as a whole"
    )

# One of these is set in a process that mpiexec, mpirun, srun or aprun has started: there a rank must not wait
# for one whose program has failed, from here on.
_LAUNCHED = (
    "OMPI_COMM_WORLD_SIZE",
    "PMIX_RANK",
    "PMI_RANK",
    "PMI_SIZE",
    "MPI_LOCALNRANKS",
    "PALS_RANKID",
    "SLURM_PROCID",
)
if any(name in os.environ for name in _LAUNCHED):
    from .ranks import abort

    abort.install()

# Of another package: a thread that imports a module of this one waits for this file, which would wait for it.
from meshing.lazily import loaded  # noqa: E402
from meshing.processor import name_kernels  # noqa: E402

name_kernels()

__version__ = "0.2.0"

# Public names by the module they stand in.
_HOME = {
    "material": ("Material", "OrthotropicMaterial"),
    "loads": ("PointForce", "EdgeLoad", "SupportMotion", "EdgeMotion", "Loads"),
    "supports": ("Support",),
    "contact.law": ("Unilateral", "Tied", "Clearance", "Coulomb"),
    "errors": ("SolveError", "SolverFailure", "UnknownName"),
    "meshing.warnings": (
        "LoadWarning",
        "BandWarning",
        "MeshWarning",
        "StepWarning",
        "AccuracyWarning",
        "BranchWarning",
        "UnitWarning",
        "LargeDisplacementWarning",
        "IncompleteHistory",
        "PlaceWarning",
    ),
    "ranks.parallel": ("RanksDiffer", "on_root"),
    "system.model": ("Model",),
    "damping": ("DampingTable", "rayleigh_factors"),
    "analysis.modal": ("modal", "ReducedModal"),
    "system.solve.modal_result": ("Modal",),
    "analysis.static": ("static",),
    "analysis.static_result": ("Static", "ReducedStatic"),
    "analysis.load_history": ("load_history", "LoadHistory", "ReducedLoadHistory"),
    "analysis.estimate": ("estimate", "Estimate"),
    "analysis.transient": ("transient",),
    "motion.history": ("History",),
    "analysis.estimate_error": ("estimate_error",),
    "analysis.periodic": ("periodic",),
    "continuation.orbit": ("Orbit",),
    "analysis.response": ("frequency_response", "load_response"),
    "continuation.branch": ("Branch",),
    "analysis.backbone": ("backbone",),
    "continuation.problems.free_branch": ("Backbone",),
    "analysis.branching": ("switch_branch",),
    "analysis.locus": ("locus", "loci", "grazing_points"),
    "continuation.problems.locus": ("Locus",),
    "analysis.swept": ("swept_response",),
    "motion.swept": ("SweptResponse",),
    "analysis.basins": ("basins",),
    "continuation.basins": ("Basins", "StartAxis"),
    "analysis.quasi_periodic": ("quasi_periodic",),
    "continuation.problems.tones": ("QuasiPeriodic",),
    "analysis.quasi_periodic_response": ("quasi_periodic_response",),
    "continuation.problems.curve_branch": ("QuasiPeriodicBranch",),
    "bodies.finite_element_model": ("FiniteElementModel", "join"),
    "bodies.readers": ("read_calculix", "read_matrices"),
    "reduction.reduced_model": ("ReducedModel",),
    "reduction.build": ("reduce",),
    "reduction.matrices": ("reduce_matrices",),
    "record.files": ("save",),
    "results.animation": ("write_animation",),
    "results.vtu": ("write_modes", "write_vtu"),
    "signals.waves": ("Harmonic", "ToneBurst", "Chirp", "Step"),
    "signals.samples": ("Samples",),
    "signals.signal": ("Custom", "Constant"),
    "study.reading": ("read",),
    "study.sweep": ("sweep",),
}

__all__ = ["__version__", *(name for names in _HOME.values() for name in names)]

__getattr__, __dir__ = loaded(__name__, _HOME)
