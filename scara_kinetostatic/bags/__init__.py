"""Recordings: read in any form into arrays of joint angles and forces, and written crash-safe.

Reading, from the bytes up: `messages` (what every source yields; bytes to arrays and back) <- `mcap_file`,
`sqlite_file`, `ros1_file` <- `reader` (which form a path has; both topics on one clock).
Writing: `writer` (message by message, crash-safe; or whole streams, in every form).
"""
