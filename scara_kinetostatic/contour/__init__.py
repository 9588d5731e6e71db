"""Contour tracking: the outline of an unknown object from a recording in which the tip slides along it."""
