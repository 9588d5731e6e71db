"""A robot that slides its tip along objects of any outline, with friction, recorded as its sensors would report it."""
