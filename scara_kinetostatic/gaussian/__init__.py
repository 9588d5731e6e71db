"""Linear models with Gaussian errors: least squares, what projection and prior leave, information, variance components.

Rows are whitened: their errors have variance 1. Nothing here knows a robot; a measurement is a few rows, (n, d, k).
"""
