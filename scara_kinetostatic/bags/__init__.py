"""Recordings: read in any form into arrays of joint angles and forces, and written crash-safe.

Reading, from the bytes up: `messages` (what every source yields) <- `mcap_file`, `sqlite_file`, `ros1_file` <-
`sources` (which form a path has) <- `cdr` (bytes to arrays) <- `reader` (both topics on one clock).
Writing: `cdr` (arrays to bytes) <- `writer` (message by message, crash-safe; or whole streams, in every form).
"""

from importlib.util import find_spec

PYPI = ('rosbags', 'mcap', 'lz4', 'zstandard')
"""What reads and writes recordings, and no package manager of ROS installs."""

if _missing := ' '.join(name for name in PYPI if find_spec(name) is None):
    raise ImportError(f'not installed: {_missing}; get it from PyPI: pip install {_missing}')
