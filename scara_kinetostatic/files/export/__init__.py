"""The calibrated arm in the formats of other software: URDF, xacro, Denavit–Hartenberg table, corrections, C header."""
