"""Recordings: read in any form into arrays of joint angles and forces, and written crash-safe.

Reading, from the bytes up: `messages` (what every source yields) <- `mcap_file`, `sqlite_file`, `ros1_file` <-
`sources` (which form a path has) <- `cdr` (bytes to arrays) <- `reader` (both topics on one clock).
Writing: `cdr` (arrays to bytes) <- `writer` (message by message, crash-safe; or whole streams, in every form).
"""

from importlib import import_module

PYPI = ('rosbags', 'mcap', 'lz4', 'zstandard')
"""What reads and writes recordings, and no package manager of ROS installs."""


def _check_installed() -> None:
    """Check that the packages from PyPI are there.

    Raises:
        ImportError: some are not.
    """
    missing = []
    for name in PYPI:
        try:
            import_module(name)
        except ImportError:
            missing.append(name)
    if missing:
        names = ' '.join(missing)
        raise ImportError(f'not installed: {names}; get it from PyPI: pip install {names}')


_check_installed()
