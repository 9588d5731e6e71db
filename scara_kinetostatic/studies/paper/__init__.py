"""Sections 4 and 5 of the paper, reproduced."""
