"""Reproduction of sections 4 and 5 of the paper."""
