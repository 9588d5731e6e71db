"""The command `scara-kinetostatic`: one file per verb, exceptions become exit statuses in `main` alone.

A verb's file has `add_parser`, cheap to call, and `run`, which imports what it needs.
"""
