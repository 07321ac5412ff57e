"""Tables as rigs write them: text, Excel, MATLAB, NumPy and Parquet files, as columns of numbers by their names."""

from __future__ import annotations

import csv
import io
import re
import zipfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from datetime import datetime
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from mrdamp.errors import LARGEST, InputError, optional
from mrdamp.files import LARGEST as LARGEST_FILE
from mrdamp.files import decode, read_bytes
from mrdamp.records.channels import listed, show
from mrdamp.records.csv_file import is_number, numbers
from mrdamp.records.sampling import Array

_SEPARATORS = ",;\t "
#: Lines among which the header is looked for.
_HEAD = 200


#: Takes a column's name and what the row below the header says of its unit; raises InputError.
CheckUnit = Callable[[str, str], None]


def columns_of(
    path: Path, wanted: Sequence[str], time: str = "", check_unit: CheckUnit | None = None
) -> dict[str, Array]:
    """The wanted columns of a table, (n,) each.

    Text may have lines above its header, a mark of comments before it, a line of units below it, further columns,
    quoted cells, `;`, tabs or spaces between cells with decimal commas, and header blocks that come again. Without a
    header the columns are 1, 2 and so on. Columns of a MATLAB structure are `structure.field`, those of a matrix
    `matrix(1)`. time: the column that may hold dates with times, ISO 8601, read as seconds from the first. check_unit:
    called for each wanted column of a row of units.

    Raises InputError: one line: no such column, a cell that is no number, a damaged file, a library that is missing.
    """
    suffix = path.suffix.lower()
    if suffix == ".xlsx":
        return _of_lines(path, list(_sheet(path)), wanted, time, check_unit)
    if suffix in _ARRAYS:
        return _picked(path, dict(_flat(_foreign(path, partial(_ARRAYS[suffix], path)))), wanted, time)
    lines = decode(str(path), read_bytes(path)).rstrip().split("\n")
    return _of_lines(path, lines, wanted, time, check_unit)


def _of_lines(
    path: Path, lines: list[str], wanted: Sequence[str], time: str, check_unit: CheckUnit | None
) -> dict[str, Array]:
    for separator in _SEPARATORS:
        for k, line in enumerate(lines[:_HEAD]):
            header = _cells(re.sub(r"^\s*[#%]+", "", line), separator)
            if set(wanted) <= set(header):
                if twice := [name for name in wanted if header.count(name) > 1]:
                    raise InputError(f"{path}: two columns are named {show(twice[0])}; rename one")
                if check_unit and _is_units(lines, k + 1):
                    for name, unit in zip(header, _cells(lines[k + 1], separator), strict=False):
                        if name in wanted:
                            check_unit(name, unit.strip("[]() "))
                return _values(path, lines, k, header, separator, wanted, time)
    numbered = all(re.fullmatch("[1-9][0-9]{0,3}", name) for name in wanted)
    for separator in _SEPARATORS if numbered else ():
        for k, line in enumerate(lines[:_HEAD]):
            cells = _cells(line, separator)
            here = [int(name) - 1 for name in wanted if name != time]
            if max(map(int, wanted)) <= len(cells) and all(is_number(cells[j].replace(",", ".")) for j in here):
                header = [str(j + 1) for j in range(len(cells))]
                return _values(path, lines, k - 1, header, separator, wanted, time)
    separator = max(_SEPARATORS[:-1], key=lines[0].count)
    separator = separator if separator in lines[0] else " "
    heads = max((_cells(line, separator) for line in lines[:_HEAD]), key=lambda cells: len(set(wanted) & set(cells)))
    missing = ", ".join(show(name) for name in dict.fromkeys(wanted) if name not in heads)
    if sum(is_number(cell.replace(",", ".")) for cell in heads) > 1:
        raise InputError(
            f"{path}: no column {missing}; the file has no header and {len(heads)} columns: name them by their numbers,"
            " such as time_s=1:ms"
        )
    raise InputError(f"{path}: no column {missing}; the file has {listed(heads)}")


def _is_units(lines: Sequence[str], k: int) -> bool:
    return k < len(lines) and not re.search(r"\d", re.sub(r"/s\^?2", "", lines[k]))


def _cells(line: str, separator: str) -> list[str]:
    if '"' in line:
        try:
            return [cell.strip() for cell in next(csv.reader([line], delimiter=separator, skipinitialspace=True))]
        except (csv.Error, StopIteration):
            pass
    return line.split() if separator == " " else [cell.strip() for cell in line.split(separator)]


def _values(
    path: Path, lines: list[str], at: int, header: list[str], separator: str, wanted: Sequence[str], time: str
) -> dict[str, Array]:
    """at: line of the header, -1 without one."""
    blocks = list(_blocks(lines, at, header, separator))
    first = dict(zip(header, _cells(blocks[0][1][0], separator), strict=False)) if blocks else {}
    stamped = time in first and not is_number(first[time].replace(",", "."))
    picked = [header.index(name) for name in wanted if not (stamped and name == time)]
    parts, stamps = [], []
    for line, rows in blocks:
        plain = [_plain(row, separator, len(header)) for row in rows]
        parts.append(numbers(str(path), header, plain, picked, line, least=1))
        columns = list(zip(*(_cells(row, separator) for row in rows), strict=False))
        decimal = _decimal_marks([columns[column] for column in picked])
        for k, column in enumerate(picked):
            _refuse_thousands(path, header[column], columns[column], parts[-1][:, k], decimal)
        if stamped:
            stamps += _stamps(path, plain, line, header.index(time), time)
    if (n := sum(map(len, parts))) < 3:
        raise InputError(f"{path}: {n} samples: at least 3 are needed")
    table = np.concatenate(parts)
    found = {header[column]: table[:, k] for k, column in enumerate(picked)}
    return found | ({time: np.array([(s - stamps[0]).total_seconds() for s in stamps])} if stamped else {})


#: A number with marks between its thousands, or with three decimals; one with decimals whatever the marks mean.
_GROUPED = re.compile(r"[-+]?\d{1,3}([.,])\d{3}(\1\d{3})*")
_DECIMAL = re.compile(r"[-+]?(?:0?|\d{4,}|\d+(?=[.,](?!\d{3}$)))([.,])\d*(?:[eE].*)?")


def _decimal_marks(columns: Sequence[Sequence[str]]) -> set[str]:
    """The marks that stand before decimals."""
    found = (_DECIMAL.fullmatch(cell) for cells in columns for cell in cells)
    return {match[1] for match in found if match}


def _refuse_thousands(path: Path, name: str, cells: Sequence[str], read: Array, decimal: set[str]) -> None:
    """Raises InputError for a column (n,) whose grouped cells are, or may be, thousands: where the other mark stands
    before all decimals of the file (`decimal`), its other cells are whole and below a thousand, or it is smoother so
    than as it was read."""
    matches = [_GROUPED.fullmatch(cell) for cell in cells]
    grouped = np.array([match is not None for match in matches])
    if not grouped.any():
        return
    others = [cell for cell, match in zip(cells, matches, strict=True) if not match]
    doubtful = bool(decimal) and decimal.isdisjoint(match[1] for match in matches if match)
    if others and not _decimal_marks([cells]):
        doubtful = doubtful or all(re.fullmatch(r"[-+]?\d{1,3}", cell) for cell in others)
    if others and not doubtful:
        whole = [float(re.sub("[.,]", "", cell)) if g else 0.0 for cell, g in zip(cells, grouped, strict=True)]
        thousands = np.where(grouped, whole, read)
        doubtful = bool(np.abs(np.diff(thousands)).max() < 0.5 * np.abs(np.diff(read)).max())
    if doubtful:
        cell = cells[int(np.argmax(grouped))]
        raise InputError(f"{path}: {show(name)} holds {show(cell)}: numbers have no marks between their thousands")


def _blocks(lines: list[str], at: int, header: list[str], separator: str) -> Iterator[tuple[int, list[str]]]:
    """First line (from 1) and rows of each block of data: a header that comes again begins a new one."""
    heads = [at, *(k for k in range(at + 1, len(lines)) if at >= 0 and lines[k] == lines[at]), len(lines)]
    for head, end in pairwise(heads):
        begin = head + 1
        if begin < end and head >= 0 and _is_units(lines, begin):
            begin += 1
        while end < len(lines) and end > begin and len(_cells(lines[end - 1], separator)) != len(header):
            end -= 1  # what stands above the next header
        if begin < end:
            yield begin + 1, lines[begin:end]


def _plain(row: str, separator: str, columns: int) -> str:
    """A row with commas between its cells and points in its numbers."""
    if '"' in row:
        row = separator.join(cell.replace(",", ".").replace(separator, "_") for cell in _cells(row, separator))
    if separator == " ":
        return ",".join(row.replace(",", ".").split())
    if row.count(separator) == columns:
        row = row.rstrip(separator)
    return row if separator == "," else row.replace(",", ".").replace(separator, ",")


def _stamps(path: Path, rows: list[str], first_line: int, column: int, name: str) -> list[datetime]:
    """Of cells with date and time, whose zone is one for all."""
    found = []
    for k, row in enumerate(rows):
        cell = row.split(",")[column].strip()
        try:
            found.append(datetime.fromisoformat(cell).replace(tzinfo=None))
        except ValueError:
            raise InputError(
                f"{path}: line {first_line + k}: {name} is neither a number nor a date with a time: {show(cell)}"
            ) from None
    return found


def _sheet(path: Path) -> Iterator[str]:
    """Rows of a workbook's active sheet, with tabs between the cells."""
    openpyxl = _library("openpyxl", path)
    book = _foreign(path, lambda data: openpyxl.load_workbook(data, read_only=True, data_only=True))
    for row in book.active.iter_rows(values_only=True):
        cells = ("" if v is None else v.isoformat() if hasattr(v, "isoformat") else str(v) for v in row)
        yield "\t".join(re.sub(r"\s+", " ", cell) for cell in cells)


#: First bytes of an HDF5 file.
_HDF5 = b"\x89HDF\r\n\x1a\n"


def _npz(_: Path, data: io.BytesIO) -> Mapping[str, Any]:
    with zipfile.ZipFile(data) as packed:
        if sum(item.file_size for item in packed.infolist()) > LARGEST_FILE:
            raise InputError(f"more than {LARGEST_FILE >> 20} MiB when unpacked")
    data.seek(0)
    with np.load(data, allow_pickle=False) as found:
        return dict(found)


def _mat(path: Path, data: io.BytesIO) -> Mapping[str, Any]:
    from scipy.io import loadmat

    if _HDF5 not in (data.getvalue()[:8], data.getvalue()[512:520]):  # version 7.3, without and with its header
        return dict(loadmat(data, simplify_cells=True))
    found: dict[str, Any] = {}
    with _library("h5py", path).File(data, "r") as file:
        file.visititems(
            lambda name, item: (
                found.update({name.replace("/", "."): np.asarray(item[()]).T}) if hasattr(item, "shape") else None
            )
        )
    return found


def _parquet(path: Path, data: io.BytesIO) -> Mapping[str, Any]:
    table = _library("pyarrow.parquet", path).read_table(data)
    return {name: table[name].to_numpy(zero_copy_only=False) for name in table.column_names}


_ARRAYS: Mapping[str, Callable[[Path, io.BytesIO], Mapping[str, Any]]] = {
    ".npz": _npz, ".mat": _mat, ".parquet": _parquet
}  # fmt: skip


def _foreign(path: Path, load: Callable[[io.BytesIO], Any]) -> Any:
    """What a library makes of a file; whatever it raises on a damaged one is an InputError."""
    try:
        return load(io.BytesIO(read_bytes(path)))
    except InputError as error:
        raise error if str(path) in str(error) else InputError(f"{path}: {error}") from None
    except Exception as error:
        raise InputError(f"{path}: no {path.suffix} file: {' '.join(str(error).split())[:120]}") from None


def _library(name: str, path: Path) -> Any:
    return optional(name, "tables", f"{path}: reading it needs {name.partition('.')[0]}")


def _flat(found: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Arrays by name: fields of structures, columns of matrices."""
    for name, value in found.items():
        if name.startswith("__"):
            continue
        if isinstance(value, Mapping):
            yield from _flat(value, f"{prefix}{name}.")
            continue
        array = np.squeeze(np.asarray(value))
        if array.ndim == 2:
            yield from ((f"{prefix}{name}({k + 1})", array[:, k]) for k in range(array.shape[1]))
        elif array.ndim == 1:
            yield f"{prefix}{name}", array


def _picked(path: Path, found: Mapping[str, Any], wanted: Sequence[str], time: str) -> dict[str, Array]:
    if missing := [show(name) for name in dict.fromkeys(wanted) if name not in found]:
        raise InputError(f"{path}: no column {', '.join(missing)}; the file has {listed(list(found))}")
    out = {}
    for name in wanted:
        array = found[name]
        if array.dtype.kind == "M" and name == time:
            array = (array - array[0]) / np.timedelta64(1, "s")
        if array.dtype.kind not in "iufb":
            raise InputError(f"{path}: {name} holds no numbers")
        out[name] = np.asarray(array, dtype=np.float64)
        if (bad := np.flatnonzero(~(np.abs(out[name]) <= LARGEST))).size:
            raise InputError(f"{path}: sample {bad[0] + 1}: {name} is no finite number up to {LARGEST:g}")
    lengths = {len(array) for array in out.values()}
    if len(lengths) != 1 or min(lengths) < 3:
        raise InputError(f"{path}: columns of {' and '.join(map(str, sorted(lengths)))} samples; one length from 3 on")
    return out
