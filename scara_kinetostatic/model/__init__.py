"""The robot, the discs and their contact: equations (1) to (11), vectorised, with derivatives."""
