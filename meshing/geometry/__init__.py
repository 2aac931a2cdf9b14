"""A person's shapes to a drawing: columns, fans and plane graphs; nothing here knows gmsh."""
