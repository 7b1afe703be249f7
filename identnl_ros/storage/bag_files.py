# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""From the path of a bag to the files that make it up."""

from pathlib import Path, PurePosixPath
import re
import stat

from identnl_ros.core.errors import DataError
from identnl_ros.storage.recorded_channel import Problems

TYPE_CHECKING = False
if TYPE_CHECKING:
    from identnl_ros.storage.mcap_file import McapFile
    from identnl_ros.storage.sqlite_file import SqliteFile

METADATA_NAME = 'metadata.yaml'
METADATA_KEY = 'rosbag2_bagfile_information'

LARGEST_METADATA = 2**24  # [bytes]

_ENDINGS = ('.mcap', '.db3')
_TABLES = ('.csv', '.txt', '.uff', '.unv', '.mat', '.tdms', '.h5', '.hdf5', '.parquet')


def open_files(path: Path, problems: Problems) -> list['McapFile | SqliteFile']:
    """
    Open all files of a bag.

    Parameters
    ----------
    path : Path
        An MCAP or SQLite file, or a folder with metadata.yaml.
    problems : Problems
        What is wrong but did not keep the bag from being read is noted here.

    Returns
    -------
    list of McapFile and SqliteFile
        In the order of recording.

    Raises
    ------
    DataError
        If the path is not a bag or cannot be read.

    """
    try:
        if not path.is_dir():
            return [_open_file(path, problems)]
        paths, compressed = _folder_contents(path, problems)
        return [_open_file(part, problems, compressed) for part in paths]
    except FileNotFoundError as error:
        raise DataError(
            f'{error.filename} does not exist; give the path of a bag: an .mcap or .db3 file, '
            f'or a folder with {METADATA_NAME}'
        ) from None
    except OSError as error:
        raise DataError(
            f'{path} cannot be read: {error.strerror or error}; check the path and permissions'
        ) from None


def _open_file(
    path: Path, problems: Problems, compressed: bool = False
) -> 'McapFile | SqliteFile':
    status = path.stat()
    if not stat.S_ISREG(status.st_mode):
        raise DataError(f'{path} is not a file; give the path of a bag')
    if status.st_size == 0:
        raise DataError(f'{path} is empty; nothing was recorded, or copying it failed')
    with path.open('rb') as stream:
        begin = stream.read(16)
    if begin.startswith(b'\x89MCAP') or path.suffix == '.mcap':
        from identnl_ros.storage.mcap_file import McapFile

        return McapFile(path, problems, compressed)
    if begin.startswith(b'SQLite format 3'):
        from identnl_ros.storage.sqlite_file import SqliteFile

        return SqliteFile(path, problems, compressed)
    raise DataError(
        f'{path} is not a bag: it is neither an MCAP nor an SQLite file'
        + ('; use `identnl import` for files of other programs' if path.suffix in _TABLES else '')
    )


def _folder_contents(folder: Path, problems: Problems) -> tuple[list[Path], bool]:
    """Files of a bag's folder and whether their messages are compressed."""
    metadata_path = folder / METADATA_NAME
    if not metadata_path.exists():
        paths = sorted(
            (path for path in folder.iterdir() if path.suffix in _ENDINGS), key=_recording_order
        )
        if not paths:
            raise DataError(
                f'{folder} is not a bag: it has neither {METADATA_NAME} nor .mcap or .db3 files'
            )
        problems.add(
            f'{folder}: {METADATA_NAME} is missing, so recording was not finished; '
            'the files were taken in the order of their names',
            ', '.join(path.name for path in paths),
        )
        return paths, False
    metadata = _read_metadata(metadata_path)
    names = metadata.get('relative_file_paths')
    if not isinstance(names, list) or not names:
        raise DataError(f'{metadata_path} names no files under relative_file_paths')
    paths = [folder / PurePosixPath(str(name)).name for name in names]
    missing = [path.name for path in paths if not path.exists()]
    if missing:
        raise DataError(
            f'{metadata_path} names files that do not exist: {", ".join(missing)}; '
            'copy them into the folder, or give the path of one file'
        )
    mode = str(metadata.get('compression_mode') or '').lower()
    if mode == 'file':
        raise DataError(
            f'{folder} holds files compressed as a whole ({paths[0].name}); decompress them '
            'with `zstd -d` and give the path of a decompressed file'
        )
    return paths, mode == 'message'


def _read_metadata(path: Path) -> dict[str, object]:
    import yaml

    if path.stat().st_size > LARGEST_METADATA:
        raise DataError(f'{path} has more than {LARGEST_METADATA} bytes; this is not a bag')
    try:
        document = yaml.safe_load(path.read_text('utf-8'))
    except (yaml.YAMLError, UnicodeError, RecursionError, ValueError):
        raise DataError(f'{path} is not readable as YAML; give the path of a bag file') from None
    content = document.get(METADATA_KEY) if isinstance(document, dict) else None
    if not isinstance(content, dict):
        raise DataError(f'{path} lacks {METADATA_KEY}; the folder is not a ROS 2 bag')
    return content


def _recording_order(path: Path) -> list[int | str]:
    """Order in which stand_2.mcap comes before stand_10.mcap."""
    return [int(part) if part.isdecimal() else part for part in re.split(r'(\d+)', path.name)]
