"""Lagrange polynomials on Gauss-Lobatto-Legendre (GLL) nodes, at points and at Gauss points."""

from meshing.gll import gll_nodes, shape_functions, tabulated

__all__ = ["gll_nodes", "shape_functions", "tabulated"]  # what is passed on
