"""The package `meshing` under a second name: `from sbfem_petsc.meshing import Beam`."""

import sys

import meshing

sys.modules[__name__] = meshing
