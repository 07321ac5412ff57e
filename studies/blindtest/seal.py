"""Sealed labels: a commitment by hash, and a masked file.

The hash of salt and labels is printed before any diagnosis starts, so that labels cannot be changed
afterwards. The file is masked against accidental reading. Its key is stored next to it, and `open_labels`
unmasks and checks it.
"""

from __future__ import annotations

import hashlib
import json
import secrets
from pathlib import Path
from typing import Any

from mrdamp.errors import InputError
from mrdamp.files import read_bytes, write_atomic

Labels = dict[str, dict[str, Any]]


def seal(folder: Path, name: str, content: Labels) -> str:
    """Masks labels into folder/NAME.sealed and returns the SHA-256 of salt and labels."""
    folder.mkdir(parents=True, exist_ok=True)
    key_file = folder / "key"
    if not key_file.exists():
        write_atomic(key_file, secrets.token_hex(32) + "\n")
    salt = secrets.token_hex(16)
    text = salt + json.dumps(content, indent=1, sort_keys=True)
    digest = hashlib.sha256(text.encode()).hexdigest()
    masked = _mask(text.encode(), _key(folder, name, digest))
    write_atomic(folder / f"{name}.sealed", f"{digest}\n{masked.hex()}\n")
    return digest


def is_sealed(folder: Path, name: str) -> bool:
    """True if there are sealed labels of that name."""
    return (folder / f"{name}.sealed").is_file()


def digest_of(folder: Path, name: str) -> str:
    """The hash from the time of sealing."""
    return _parts(folder, name)[0]


def open_labels(folder: Path, name: str) -> tuple[str, Labels]:
    """Salt and labels; raises InputError if they differ from the sealed ones."""
    digest, masked = _parts(folder, name)
    text = _mask(masked, _key(folder, name, digest))
    if hashlib.sha256(text).hexdigest() != digest:
        raise InputError(f"{folder / name}.sealed: the labels are not those whose hash was given: {digest}")
    salt, content = text[:32].decode(), json.loads(text[32:])
    return salt, content


def _parts(folder: Path, name: str) -> tuple[str, bytes]:
    path = folder / f"{name}.sealed"
    lines = read_bytes(path).decode().split("\n")
    try:
        return lines[0], bytes.fromhex(lines[1])
    except (IndexError, ValueError):
        raise InputError(f"{path}: damaged; a hash and a line of hexadecimal digits are needed") from None


def _key(folder: Path, name: str, digest: str) -> bytes:
    return hashlib.sha256(read_bytes(folder / "key") + f"{name} {digest}".encode()).digest()


def _mask(data: bytes, key: bytes) -> bytes:
    """Exclusive or with a stream of SHA-256 blocks; its own inverse."""
    blocks = range(-(-len(data) // 32))
    stream = b"".join(hashlib.sha256(key + block.to_bytes(8)).digest() for block in blocks)
    return bytes(a ^ b for a, b in zip(data, stream[: len(data)], strict=True))
