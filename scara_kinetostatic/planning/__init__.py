"""Optimal design of a calibration: how many touches, on which discs, where, in which posture and with which force."""
