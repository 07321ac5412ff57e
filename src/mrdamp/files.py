"""Reading whole files (plain or gzip) and writing them atomically, with one-line errors."""

from __future__ import annotations

import gzip
import io
import os
import zlib
from pathlib import Path

from mrdamp.errors import InputError

_GZIP_MAGIC = b"\x1f\x8b"


def read_bytes(path: Path) -> bytes:
    """Bytes of a file as they are on disk.

    Raises:
        InputError: the file is not there or cannot be read.
    """
    try:
        return path.read_bytes()
    except FileNotFoundError:
        raise InputError(f"{path}: no such file") from None
    except IsADirectoryError:
        raise InputError(f"{path}: is a folder, a file is needed") from None
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: cannot be read: {_reason(error)}") from None


def decode(name: str, data: bytes) -> str:
    """Text of a file's bytes; a name that ends in .gz is unpacked first. Line ends become ``\\n``.

    Args:
        name: the file's name, for its suffix and for the error line.
        data: the bytes on disk.

    Raises:
        InputError: empty, not gzip, truncated or damaged gzip, not UTF-8 text.
    """
    if not data:
        raise InputError(f"{name}: the file is empty")
    if name.lower().endswith(".gz"):
        if not data.startswith(_GZIP_MAGIC):
            raise InputError(f"{name}: the name ends in .gz and the content is not gzip")
        try:
            data = gzip.decompress(data)
        except EOFError:
            raise InputError(f"{name}: the gzip data is truncated: copy the file again") from None
        except (OSError, zlib.error) as error:
            raise InputError(f"{name}: the gzip data is damaged: {_reason(error)}") from None
    elif data.startswith(_GZIP_MAGIC):
        raise InputError(f"{name}: the content is gzip: the name must end in .gz")
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(f"{name}: not a text file (byte {error.start} is not UTF-8)") from None
    if not text.strip():
        raise InputError(f"{name}: the file is empty")
    return text.replace("\r\n", "\n").replace("\r", "\n")


def write_atomic(path: Path, text: str) -> None:
    """Write text to a file in one go: either the whole new file is there or the old one stays.

    A name that ends in .gz is packed; the bytes depend on the text only (no time, no name inside).

    Raises:
        InputError: the folder is missing or cannot be written.
    """
    data = text.encode("utf-8")
    if path.name.lower().endswith(".gz"):
        packed = io.BytesIO()
        with gzip.GzipFile(filename="", mode="wb", compresslevel=9, fileobj=packed, mtime=0) as stream:
            stream.write(data)
        data = packed.getvalue()
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        try:
            temporary.write_bytes(data)
            os.replace(temporary, path)
        finally:
            temporary.unlink(missing_ok=True)
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {_reason(error)}") from None


def _reason(error: Exception) -> str:
    """One line of an exception's text, without the path that the caller puts in front."""
    text = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
    return " ".join(str(text).split())[:120]
