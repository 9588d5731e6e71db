"""Recordings: reading any form into arrays, writing them crash-safe, finding the touches in them.

From the bytes up: `raw` (what every source gives) <- `mcap_checksum`, `mcap_records`
<- `mcap_file`, `sqlite_file`, `ros1_file`, `bag_folder` <- `sources` (which form is it) <- `decoding` (bytes to
arrays) <- `clock` (both topics on one clock) <- `reader`. The other way:
`encoding`, `metadata`, `mcap_piece`, `mcap_join`, `folders` <- `bag_writer` (live)
<- `writer` (arrays). The cell description: `yaml_text` <- `cell_file`.
"""
