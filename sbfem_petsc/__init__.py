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

_HOME = {
    "Material": "material",
    "OrthotropicMaterial": "material",
    "PointForce": "loads",
    "EdgeLoad": "loads",
    "SupportMotion": "loads",
    "EdgeMotion": "loads",
    "Loads": "loads",
    "Support": "supports",
    "Unilateral": "contact.law",
    "Tied": "contact.law",
    "Clearance": "contact.law",
    "Coulomb": "contact.law",
    "SolveError": "errors",
    "UnknownName": "errors",
    "LoadWarning": "meshing.warnings",
    "BandWarning": "meshing.warnings",
    "MeshWarning": "meshing.warnings",
    "StepWarning": "meshing.warnings",
    "AccuracyWarning": "meshing.warnings",
    "BranchWarning": "meshing.warnings",
    "UnitWarning": "meshing.warnings",
    "LargeDisplacementWarning": "meshing.warnings",
    "IncompleteHistory": "meshing.warnings",
    "PlaceWarning": "meshing.warnings",
    "RanksDiffer": "ranks.parallel",
    "Model": "system.model",
    "DampingTable": "damping",
    "rayleigh_factors": "damping",
    "modal": "analysis.modal",
    "Modal": "system.solve.modal_result",
    "static": "analysis.static",
    "Static": "analysis.static_result",
    "load_history": "analysis.load_history",
    "LoadHistory": "analysis.load_history",
    "estimate": "analysis.estimate",
    "Estimate": "analysis.estimate",
    "transient": "analysis.transient",
    "History": "motion.history",
    "estimate_error": "analysis.estimate_error",
    "periodic": "analysis.periodic",
    "Orbit": "continuation.orbit",
    "frequency_response": "analysis.response",
    "load_response": "analysis.response",
    "Branch": "continuation.branch",
    "backbone": "analysis.backbone",
    "Backbone": "continuation.problems.free_branch",
    "switch_branch": "analysis.branching",
    "locus": "analysis.locus",
    "Locus": "continuation.problems.locus",
    "loci": "analysis.locus",
    "grazing_points": "analysis.locus",
    "swept_response": "analysis.swept",
    "SweptResponse": "motion.swept",
    "basins": "analysis.basins",
    "Basins": "continuation.basins",
    "StartAxis": "continuation.basins",
    "quasi_periodic": "analysis.quasi_periodic",
    "QuasiPeriodic": "continuation.problems.tones",
    "quasi_periodic_response": "analysis.quasi_periodic_response",
    "QuasiPeriodicBranch": "continuation.problems.curve_branch",
    "FiniteElementModel": "bodies.finite_element_model",
    "read_calculix": "bodies.calculix",
    "read_matrices": "bodies.matrix_files",
    "join": "bodies.join",
    "ReducedModel": "reduction.reduced_model",
    "ReducedModal": "analysis.modal",
    "ReducedStatic": "analysis.static_result",
    "ReducedLoadHistory": "analysis.load_history",
    "reduce": "reduction.build",
    "reduce_matrices": "reduction.matrices",
    "save": "record.files",
    "read": "record.files",
    "write_animation": "results.animation",
    "write_modes": "results.vtu",
    "write_vtu": "results.vtu",
    "Harmonic": "signals.waves",
    "ToneBurst": "signals.waves",
    "Chirp": "signals.waves",
    "Step": "signals.waves",
    "Samples": "signals.samples",
    "Custom": "signals.signal",
    "Constant": "signals.signal",
    "on_root": "ranks.parallel",
    "sweep": "study.sweep",
}

__all__ = ["__version__", *_HOME]

__getattr__, __dir__ = loaded(__name__, _HOME)
