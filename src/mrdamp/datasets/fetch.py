"""Sets from their public source, checked by hash."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any
from urllib.parse import unquote

from mrdamp.datasets.catalogue import Dataset
from mrdamp.datasets.convert import CONVERTERS
from mrdamp.errors import InputError
from mrdamp.files import decode, read_bytes, write_atomic

Progress = Callable[[str, float], None]

HASHES = "hashes.json"


def fetch(known: Dataset, folder: Path, progress: Progress | None = None) -> Path:
    """Fetches a set into folder/NAME: the source's files into `source/`, and records where they can be made.

    Files with the right hash are not fetched again, so an interrupted fetch continues. Hashes are the catalogue's, the
    archive's own for a DOI, or those of the first fetch, which are kept in `hashes.json`. Raises
    InputError: no public source, pooch missing, no connection, a wrong hash.
    """
    if known.source is None:
        raise InputError(
            f"data set {known.name} cannot be fetched ({known.licence} licence); it is at {known.url}"
        )
    root = folder / known.name
    kept = root / HASHES
    seen: dict[str, str] = json.loads(decode(str(kept), read_bytes(kept))) if kept.is_file() else {}
    puller = _puller(known, root / "source", seen)
    files = sorted(puller.registry)
    for count, name in enumerate(files):
        if progress:
            progress(Path(unquote(name)).name, count / len(files))
        path = _pull(puller, name, known.url)
        if name not in seen:
            seen[name] = f"sha256:{hashlib.sha256(path.read_bytes()).hexdigest()}"
            write_atomic(kept, json.dumps(seen, indent=1) + "\n")
        if known.source.converter:
            half, record = CONVERTERS[known.source.converter](path)
            (root / half).mkdir(exist_ok=True)
            record.save(root / half / f"{record.name}.csv.gz")
    return root


def _puller(known: Dataset, folder: Path, seen: dict[str, str]) -> Any:
    try:
        import pooch  # type: ignore[import-untyped]
    except ImportError:
        raise InputError("fetching needs pooch, which is not installed: pip install 'mrdamp[data]'") from None
    assert known.source is not None
    pooch.get_logger().setLevel("WARNING")
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{folder}: cannot be made: {error.strerror}") from None
    # On disk a file has the last part of its name, without the revision and what is quoted.
    names = {name: Path(unquote(name)).name for name in known.source.files}
    puller = pooch.create(
        path=folder, base_url=known.source.base,
        urls={short: known.source.base + name for name, short in names.items()},
        registry={short: known.source.files[name] or seen.get(short) for name, short in names.items()},
    )  # fmt: skip
    if not names:
        try:
            puller.load_registry_from_doi()
        except Exception as error:  # whatever the connection or the archive raises
            raise InputError(f"{known.source.base}: {_line(error)}; fetch by hand from {known.url}") from None
    return puller


def _pull(puller: Any, name: str, url: str) -> Path:
    import requests

    try:
        return Path(puller.fetch(name))
    except ValueError as error:  # pooch has taken the file away again
        raise InputError(f"{name}: the hash is not the known one; {_line(error)}") from None
    except (OSError, requests.RequestException) as error:
        raise InputError(f"{name}: {_line(error)}; fetch by hand from {url}") from None


def _line(error: Exception) -> str:
    """One line of an error; without a connection its end, where the system says why, is left out."""
    host = re.match(r"HTTPS?ConnectionPool\(host='([^']*)'", str(error))
    return f"no connection to {host[1]}" if host else " ".join(str(error).split())[:160]
