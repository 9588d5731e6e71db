"""Kinetostatic calibration of a SCARA robot by touch."""
