"""Shapes to cells, and cells to S-elements."""
