"""The command `scara-kinetostatic`: one file per verb; exceptions become exit statuses in `main` alone.

A verb's file has `add_parser`, which must be fast, and `run`, which imports what it needs. `arguments` has what
verbs share of their arguments, `output` what they share of their output.
"""
