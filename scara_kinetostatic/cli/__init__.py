"""The command `scara-kinetostatic`: one file per verb; exceptions become exit statuses in `main` alone.

A verb's file has its help as docstring, a table of its `ARGUMENTS`, and `run`, which imports what it needs. `arguments`
has what verbs share.
"""
