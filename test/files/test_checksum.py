"""The checksum of a recording is the one that its documentation computes."""

from __future__ import annotations

import hashlib
import os
import subprocess
from pathlib import Path

from scara_kinetostatic.files.atomic import recording_checksum


def test_of_a_file_it_is_that_of_its_bytes(tmp_path: Path) -> None:
    content = os.urandom(3_000_000)
    (tmp_path / 'touches.csv').write_bytes(content)
    assert recording_checksum(tmp_path / 'touches.csv') == hashlib.sha256(content).hexdigest()


def test_of_a_folder_it_is_that_of_the_documented_command(tmp_path: Path) -> None:
    for name in ('metadata.yaml', 'bag_0.mcap', 'bag_10.mcap', 'Bag.db3', '.bag_11.mcap.part'):
        (tmp_path / name).write_text(name)
    found = recording_checksum(tmp_path)
    assert recording_checksum.__doc__ is not None
    lines = recording_checksum.__doc__.split('cd FOLDER\n', 1)[1].split('\n\n', 1)[0]
    output = subprocess.run(['sh', '-c', lines], cwd=tmp_path, check=True, capture_output=True, text=True).stdout
    assert output.split()[0] == found
    (tmp_path / 'report.html').write_text('not a part of the recording')
    assert recording_checksum(tmp_path) == found
    (tmp_path / '.bag_11.mcap.part').write_text('changed')
    assert recording_checksum(tmp_path) != found
