"""Recordings: read in any form into arrays of joint angles and forces, and written crash-safe.

Reading, from the bytes up: `messages` (what every source yields) <- `mcap_file`, `sqlite_file`, `ros1_file` <-
`cdr` (bytes to arrays) <- `reader` (which form a path has; both topics on one clock).
Writing: `cdr` (arrays to bytes) <- `writer` (message by message, crash-safe; or whole streams, in every form).
"""
