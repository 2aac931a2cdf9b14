"""What a person describes: notches, cracks, holes, beams, plates; nothing here knows a mesher."""
