"""A user's gmsh model to cells."""
