r"""SHA-256 of a recording, to tell later from which data a result was calculated.

Of a file it is that of its bytes, as `sha256sum FILE` prints it. Of a rosbag2 folder it is that of the list that
`sha256sum` prints of its files, sorted by name:

    cd FOLDER
    find . -maxdepth 1 -type f \( -name metadata.yaml -o -name '*.mcap' -o -name '*.db3' -o -name '*.zstd' \
      -o -name '*.part' \) -exec sha256sum {} + | LC_ALL=C sort -k2 | sha256sum

Other files in the folder, such as notes or results, do not count. Files are read piece by piece.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Sequence
from pathlib import Path

from scara_kinetostatic.errors import InputError


def recording_checksum(path: str | Path) -> str:
    """SHA-256 of a file, or of the files of a rosbag2 folder, hexadecimal.

    Raises:
        OSError: a file cannot be read.
    """
    path = Path(path)
    if not path.is_dir():
        return _file_checksum(path)
    stored = re.compile(r'metadata\.yaml|.+\.(mcap|db3|zstd|part)', re.DOTALL)
    files = [file for file in path.iterdir() if stored.fullmatch(file.name) and file.is_file()]
    files.sort(key=lambda file: file.name.encode())
    listing = ''.join(f'{_file_checksum(file)}  ./{file.name}\n' for file in files)
    return hashlib.sha256(listing.encode('utf-8', 'surrogateescape')).hexdigest()


def _file_checksum(file: Path) -> str:
    digest = hashlib.sha256()
    with file.open('rb') as stream:
        while piece := stream.read(1 << 20):
            digest.update(piece)
    return digest.hexdigest()


def check_different(paths: Sequence[Path]) -> None:
    """Check that no input is given twice: counted twice, its data would make the result look better than it is.

    Raises:
        InputError: two paths are the same file or folder.
    """
    places: set[Path] = set()
    for path in paths:
        place = path.resolve()
        if place in places:
            raise InputError(path, 'is given twice', 'give each input once')
        places.add(place)
