"""Recordings: read in any form into arrays of joint angles and forces, and written crash-safe.

Reading, from the bytes up: `messages` (what every source yields) <- `decompression`, `mcap_records` <- `mcap_file`,
`sqlite_file`, `ros1_file`, `bag_folder` <- `sources` (which form a path has) <- `decoding` (bytes to arrays) <- `clock`
(both topics on one clock) <- `reader`.
Writing: `encoding` (arrays to bytes), `metadata`, `mcap_writer` <- `bag_writer` (message by message, crash-safe) <-
`writer` (whole streams, in every form).
"""
