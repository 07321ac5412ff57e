"""Reading whole files (plain or gzip) and writing them atomically, with one-line errors."""

from __future__ import annotations

import csv
import gzip
import hashlib
import io
import json
import os
import stat
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import IO, Any

from mrdamp.errors import InputError

#: What the name of a record ends in, in upper or lower case.
SUFFIXES = (".csv", ".csv.gz")
_GZIP_MAGIC = b"\x1f\x8b"
#: Bytes that a file may hold, unpacked: ten million samples of a record; and those of a JSON file.
LARGEST, _LARGEST_JSON = 1 << 29, 1 << 26
#: Of a whole number in JSON.
_DIGITS = 30
#: Files that wait for the end of `together`: as each is written -> where it belongs.
_waiting: dict[Path, Path] | None = None


def read_bytes(path: Path) -> bytes:
    """Bytes of a file as they are on disk. Raises InputError: the file is not there, is no regular file, is too large
    or cannot be read."""
    try:
        about = path.stat()
        if not stat.S_ISREG(about.st_mode) and not stat.S_ISDIR(about.st_mode):
            raise InputError(f"{path}: is a device or a pipe, a file is needed")
        if about.st_size > LARGEST:
            raise _too_large(str(path), LARGEST)
        return path.read_bytes()
    except FileNotFoundError:
        raise InputError(f"{path}: no such file") from None
    except IsADirectoryError:
        raise InputError(f"{path}: is a folder, a file is needed") from None
    except InputError:
        raise
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: cannot be read: {_reason(error)}") from None


def files_in(path: Path, suffixes: tuple[str, ...] = SUFFIXES) -> list[Path]:
    """A file, or those of a folder whose names end so, by name; hidden ones are left out. Raises InputError: there is
    nothing there, or none in the folder."""
    if not path.is_dir():
        if not path.exists():
            raise InputError(f"{path}: no such folder or file")
        return [path]
    named = [
        f
        for f in sorted(path.iterdir(), key=lambda f: f.name)
        if f.name.lower().endswith(suffixes) and not f.name.startswith(".")
    ]
    for lost in (f for f in named if not f.exists()):
        raise InputError(f"{lost}: a link to nothing; give it its file or remove it")
    found = [f for f in named if f.is_file()]
    if not found:
        raise InputError(f"{path}: no {' or '.join(suffixes)} in this folder")
    return found


def decode(name: str, data: bytes) -> str:
    """Text of a file's bytes, line ends as newlines; what is called name.gz is unpacked first.

    Raises InputError: empty, not gzip, truncated or damaged gzip, too large when unpacked, not UTF-8 text.
    """
    if not data:
        raise InputError(f"{name}: the file is empty")
    if name.lower().endswith(".gz"):
        if not data.startswith(_GZIP_MAGIC):
            raise InputError(f"{name}: the name ends in .gz and the content is not gzip")
        try:
            data = gzip.GzipFile(fileobj=io.BytesIO(data)).read(LARGEST + 1)
        except EOFError:
            raise InputError(f"{name}: the gzip data is truncated: copy the file again") from None
        except (OSError, zlib.error) as error:
            raise InputError(f"{name}: the gzip data is damaged: {_reason(error)}") from None
        if len(data) > LARGEST:
            raise _too_large(name, LARGEST)
    elif data.startswith(_GZIP_MAGIC):
        raise InputError(f"{name}: the content is gzip: the name must end in .gz")
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(f"{name}: not a text file (byte {error.start} is not UTF-8)") from None
    if not text or text.isspace():
        raise InputError(f"{name}: the file is empty")
    return text.replace("\r\n", "\n").replace("\r", "\n")


def read_json(path: Path) -> Any:
    """Content of a JSON file. Raises InputError: as `read_bytes` and `decode`; no JSON, a key twice in one object, NaN
    or infinity, a whole number of more than 30 digits, objects thousands deep."""
    text = decode(str(path), read_bytes(path))
    if len(text) > _LARGEST_JSON:
        raise _too_large(str(path), _LARGEST_JSON)
    try:
        return json.loads(text, object_pairs_hook=_once, parse_int=_whole, parse_constant=_refused)
    except json.JSONDecodeError as error:
        raise InputError(f"{path}: no JSON (line {error.lineno}: {error.msg})") from None
    except RecursionError:
        raise InputError(f"{path}: no JSON of ours: objects or lists are nested too deeply") from None
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for key, value in pairs:
        if key in found:
            raise InputError(f"{key!r} stands twice in one object; allowed: once")
        found[key] = value
    return found


def _whole(digits: str) -> int:
    if len(digits) > _DIGITS:
        raise InputError(f"it holds a whole number of {len(digits)} digits; allowed: at most {_DIGITS}")
    return int(digits)


def _refused(constant: str) -> float:
    raise InputError(f"it holds {constant}; allowed: finite numbers")


def digest(of: Any) -> str:
    """16 hexadecimal digits of the SHA-256 of what JSON can hold."""
    return hashlib.sha256(json.dumps(of, sort_keys=True).encode()).hexdigest()[:16]


def differing(one: Mapping[str, Any], other: Mapping[str, Any], within: str = "") -> Iterator[str]:
    """Names of what is not alike in two mappings, `NAME.NAME` of what is in one within."""
    for name in {**one, **other}:
        a, b = one.get(name), other.get(name)
        if isinstance(a, Mapping) and isinstance(b, Mapping):
            yield from differing(a, b, f"{within}{name}.")
        elif a != b:
            yield f"{within}{name}"


def csv_text(head: Sequence[str], lines: Iterable[Sequence[object]]) -> str:
    """A table as CSV; None is an empty field."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(head)
    writer.writerows(lines)
    return out.getvalue()


def write_atomic(path: Path, content: str | bytes | Iterable[str] | Callable[[IO[bytes]], object]) -> None:
    """Write a file in one go: either the whole new file is there or the old one stays.

    Text may come in parts, which are made as they are written, and bytes from a function that writes them. A link is
    written through. A name that ends in .gz is packed; the bytes depend on the text only (no time, no name inside).

    Raises InputError: the folder is missing or cannot be written, or the path is a device or a pipe.
    """
    if callable(content):
        content(made := io.BytesIO())
        content = made.getvalue()
    parts = (content,) if isinstance(content, str | bytes) else content
    real = Path(os.path.realpath(path))
    temporary = real.with_name(f".{real.name}.{os.getpid()}.tmp")
    if reason := unfit(path):
        raise InputError(f"{path}: cannot be written: {reason}")
    try:
        try:
            with open(temporary, "wb") as file:
                packed = path.name.lower().endswith(".gz")
                opened = gzip.GzipFile("", "wb", 9, file, mtime=0) if packed else nullcontext(file)
                with opened as stream:
                    for part in parts:
                        stream.write(part.encode("utf-8") if isinstance(part, str) else part)
            if _waiting is None:
                os.replace(temporary, real)
            else:
                _waiting[temporary] = real
        except BaseException:
            temporary.unlink(missing_ok=True)
            raise
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {_reason(error)}") from None


@contextmanager
def together() -> Iterator[None]:
    """The files that are written within appear together at its end, or none of them where one cannot be written."""
    global _waiting
    if _waiting is not None:
        yield
        return
    waiting: dict[Path, Path] = {}
    _waiting = waiting
    try:
        yield
        for temporary, real in waiting.items():
            os.replace(temporary, real)
    finally:
        _waiting = None
        for temporary in waiting:
            temporary.unlink(missing_ok=True)


def unfit(path: Path) -> str:
    """Why a file must not be replaced: it is a folder, no regular file, or write-protected; empty where it may be."""
    if path.is_dir():
        return "it is a folder"
    # What a shell has opened would be swapped under it.
    opened = os.path.abspath(path).startswith(("/dev/std", "/dev/fd/", "/proc/"))
    if opened or (path.exists() and not path.is_file()):
        return "it is a device or a pipe"
    return "it is write-protected" if path.exists() and not os.access(path, os.W_OK) else ""


def _too_large(name: str, most: int) -> InputError:
    return InputError(f"{name}: more than {most >> 20} MiB; allowed: at most so much in one file")


def _reason(error: Exception) -> str:
    """One line of an exception's text, without the path that the caller puts in front."""
    text = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
    return " ".join(str(text).split())[:120]
