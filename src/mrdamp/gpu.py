"""The chain on an NVIDIA GPU: its C++ sources, compiled by NVRTC at run time for one law and the attributes in use.

Compiled code is kept in `$XDG_CACHE_HOME/mrdamp` (default `~/.cache/mrdamp`), by the hash of sources, options and
compiler. Compiling needs no GPU.
"""

from __future__ import annotations

import ctypes
import functools
import hashlib
import os
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mrdamp.errors import InputError
from mrdamp.files import write_atomic
from mrdamp.model.attributes import MISREADING, attributes, defaults

if TYPE_CHECKING:
    from mrdamp.model.core import Sets

try:
    from cuda.bindings import driver, nvrtc
except ImportError:
    driver = nvrtc = None

Array = NDArray[np.float64]
#: Bytes of a thread's stack: the compiler cannot bound that of the chain's nested solves.
_STACK = 16384
_BLOCK = 64  # threads
_OPTIONS = ("-std=c++17", "-default-device", "-diag-suppress=20044")
#: Least compute capability, times ten; share of the free memory that is used at once.
_LEAST, _SHARE = 70, 0.8


def free_attributes(params: Array) -> tuple[int, ...]:
    """Numbers of the attributes that are not neutral in params (..., attributes); the others are compiled in."""
    rows, neutral = params.reshape(-1, params.shape[-1]), defaults()
    given = ~((rows == neutral) | (np.isnan(rows) & np.isnan(neutral)))
    return tuple(int(k) for k in np.flatnonzero(given.any(axis=0)))


def fields(free: tuple[int, ...]) -> str:
    """`core/fields.h`: the members of `Params`, all but `free` as constants."""

    def literal(x: float) -> str:
        return "kUnset" if np.isnan(x) else f"{'-' if x < 0 else ''}kInf" if np.isinf(x) else repr(float(x))

    lines = []
    for k, (row, value) in enumerate(zip(attributes(), defaults(), strict=True)):
        kind = "Real" if k in free else "static constexpr double"
        lines.append(f"{kind} {row.name} = {literal(value)};\n")
    return "".join(lines)


def sources() -> Path:
    """Folder of the C++ sources; raises ImportError where the package lacks them."""
    for folder in sys.modules["mrdamp"].__path__:
        path = Path(folder) / "cpp"
        if (path / "device" / "worlds.cu").is_file():
            return path
    raise ImportError("mrdamp: the C++ sources are missing from the package; install again: pip install .")


def compiled(what: str, law: str, free: tuple[int, ...], arch: int, dampers: int = 1) -> bytes:
    """Code for a GPU of compute capability `arch` (80: 8.0). what: `worlds` or `records`, of the sources in `device`.
    Raises InputError with the compiler's first line."""
    require_cuda()
    root, text, name = sources(), fields(free), f"{what}.cu"
    kind = "".join(word.capitalize() for word in law.split("_"))  # in C++, as BoucWen
    definitions = (f"-DMRDAMP_PACK_LAW=k{kind}", "-DMRDAMP_FIELDS", f"-DMRDAMP_DAMPERS={dampers}")
    options = (*_OPTIONS, *definitions, f"-arch=sm_{arch}")
    kept = _cache(root, "\n".join((name, text, *options)))
    if kept.is_file():
        return kept.read_bytes()
    main = (root / "device" / name).read_bytes()
    program = checked(nvrtc.nvrtcCreateProgram(main, name.encode(), 1, [text.encode()], [b"core/fields.h"]))
    folders = (root / "device" / "std", root, root.parent / "include")
    given = [o.encode() for o in (*options, *(f"-I{folder}" for folder in folders))]
    (result,) = nvrtc.nvrtcCompileProgram(program, len(given), given)
    if result != nvrtc.nvrtcResult.NVRTC_SUCCESS:
        log = b" " * checked(nvrtc.nvrtcGetProgramLogSize(program))
        nvrtc.nvrtcGetProgramLog(program, log)
        raise InputError(f"the GPU's compiler: {log.decode(errors='replace').strip().splitlines()[0]}")
    code: bytes = b" " * checked(nvrtc.nvrtcGetCUBINSize(program))
    nvrtc.nvrtcGetCUBIN(program, code)
    nvrtc.nvrtcDestroyProgram(program)
    kept.parent.mkdir(parents=True, exist_ok=True)
    write_atomic(kept, code)
    return code


def _cache(root: Path, options: str) -> Path:
    digest = hashlib.sha256(options.encode())
    digest.update(repr(nvrtc.nvrtcVersion()).encode())
    for path in sorted(p for p in root.rglob("*") if p.is_file()):
        digest.update(str(path.relative_to(root)).encode())
        digest.update(path.read_bytes())
    home = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(home) / "mrdamp" / f"{digest.hexdigest()[:32]}.cubin"


def require_cuda() -> None:
    if driver is None:
        raise InputError("dampers on a GPU need the extra `cuda`: pip install 'mrdamp[cuda]'")


def checked(answer: tuple[Any, ...]) -> Any:
    """What a call of the driver or the compiler returns; raises InputError with its error's name."""
    error, *values = answer
    if int(error) != 0:
        raise InputError(f"CUDA: {error.name}")
    return values[0] if len(values) == 1 else tuple(values)


class Device(NamedTuple):
    """A GPU: its name, its compute capability times ten, and its context as a number."""

    name: str
    arch: int
    context: int


@functools.cache
def first_device() -> Device:
    """The first GPU. Raises InputError without a driver or a GPU."""
    require_cuda()
    try:
        checked(driver.cuInit(0))
        handle = checked(driver.cuDeviceGet(0))
    except (RuntimeError, InputError) as error:  # a missing driver is a RuntimeError
        raise InputError("there is no NVIDIA GPU or no driver for it here; leave device out") from error
    kinds = driver.CUdevice_attribute
    major, minor = (
        checked(driver.cuDeviceGetAttribute(getattr(kinds, f"CU_DEVICE_ATTRIBUTE_COMPUTE_CAPABILITY_{end}"), handle))
        for end in ("MAJOR", "MINOR")
    )
    name = checked(driver.cuDeviceGetName(128, handle)).rstrip(b"\0").decode()
    return Device(name, 10 * major + minor, int(checked(driver.cuDevicePrimaryCtxRetain(handle))))


class Kernels:
    """Functions of a compiled module on a device. Raises InputError for a card or driver that cannot run them."""

    def __init__(self, device: Any, code: bytes, names: Sequence[str]) -> None:
        self.device = device
        with Current(device):
            limit = driver.CUlimit.CU_LIMIT_STACK_SIZE
            checked(driver.cuCtxSetLimit(limit, max(_STACK, checked(driver.cuCtxGetLimit(limit)))))
            self.module = checked(driver.cuModuleLoadData(code))
            self.functions = {n: checked(driver.cuModuleGetFunction(self.module, n.encode())) for n in names}

    def launch(self, what: str, argument: ctypes.Structure, count: int, stream: int = 0) -> None:
        """In `count` threads, on a CUDA stream; joins a graph that is captured there."""
        pointers = (ctypes.c_void_p * 1)(ctypes.addressof(argument))
        grid = (count + _BLOCK - 1) // _BLOCK
        with Current(self.device):
            function = self.functions[what]
            checked(driver.cuLaunchKernel(function, grid, 1, 1, _BLOCK, 1, 1, 0, stream, ctypes.addressof(pointers), 0))


class Current:
    def __init__(self, device: Any) -> None:
        self.context = driver.CUcontext(int(device.context))

    def __enter__(self) -> None:
        checked(driver.cuCtxPushCurrent(self.context))

    def __exit__(self, *_: object) -> None:
        checked(driver.cuCtxPopCurrent())


@functools.cache
def kernels(device: Any, what: str, law: str, free: tuple[int, ...], dampers: int = 1) -> Kernels:
    """The kernels of `compiled` for a device, kept. device: with `name`, `arch` and `context`, as Warp's."""
    if device.arch < _LEAST:
        raise InputError(f"{device.name}: compute capability {device.arch / 10:.1f}; dampers need {_LEAST / 10:.1f}")
    names = ("run",) if what == "records" else ("act", "read")
    return Kernels(device, compiled(what, law, free, device.arch, dampers), names)


class Records(ctypes.Structure):
    """`Records` of `device/records.cu`."""

    _fields_ = (
        *((name, ctypes.c_int) for name in ("sets", "n", "columns", "hold", "begin", "end")),
        ("dt", ctypes.c_double),
        *((name, ctypes.c_void_p) for name in ("params", "x", "v", "a", "u", "column", "moved", "out")),
    )


class Task(NamedTuple):
    """Parameter sets of one law through a record.

    free: numbers of the attributes in use. params (sets, attributes in use). inputs: x, v, a, u, (n,) each. record:
    without sets and addresses. moved: true if a displacement channel reads something else than the motion.
    """

    law: str
    free: tuple[int, ...]
    params: Array
    inputs: tuple[Array, ...]
    columns: NDArray[np.int32]
    record: Records
    moved: bool

    def run(self, launch: Callable[[Records], None], put: Put, out: Array, first: int) -> None:
        """Sets from `first` on into out (sets, columns, n)."""
        some, record = self.params[first : first + len(out)], self.record
        record.sets, record.params = len(some), put(some)
        record.x, record.v, record.a, record.u = map(put, self.inputs)
        record.column = put(self.columns)
        record.moved = put(np.empty((len(some), _ROOM, record.n))) if self.moved else None
        record.out = put(out)
        launch(record)


#: Numbers a sample where a channel reads something else than the motion: kRoom of core/shift.h.
_ROOM = 21
#: Takes an array to where the kernel runs; its address there.
Put = Callable[[NDArray[Any]], int]


def run_records(
    law: str,
    records: Sequence[Sets],
    leads: Sequence[slice | None],
    columns: Sequence[int],
    launch: Callable[[Task], Array] | None = None,
) -> list[Array]:
    """`mrdamp.model.core.run_records` on the first GPU, of what it has checked. leads: samples that lead into each
    record's motion. columns: numbers. launch: in place of a GPU. Raises InputError."""
    each = zip(records, leads, strict=True)
    return [(launch or on_gpu)(_task(law, one, lead, columns)) for one, lead in each]


def _task(law: str, one: Sets, lead: slice | None, columns: Sequence[int]) -> Task:
    number = {row.name: k for k, row in enumerate(attributes())}
    params = np.atleast_2d(np.array(one.params, dtype=float))
    if one.substep is not None:
        params[:, number["substep"]] = one.substep
    x = np.ascontiguousarray(one.x, dtype=float)
    v = _rate(x, one.dt) if one.v is None else np.ascontiguousarray(one.v, dtype=float)
    a = _rate(v, one.dt) if one.a is None else np.ascontiguousarray(one.a, dtype=float)
    begin, end = (lead.start, lead.stop) if lead else (0, 0)
    free = free_attributes(params)
    record = Records(0, len(x), len(columns), int(one.hold), begin, end, one.dt)
    inputs = (x, v, a, np.ascontiguousarray(one.u, dtype=float))
    moved = any(number[name] in free for name in MISREADING)
    params = np.ascontiguousarray(params[:, list(free)])
    return Task(law, free, params, inputs, np.array(columns, np.int32), record, moved)


def _rate(of: Array, dt: float) -> Array:
    """Differentiated as the library does."""
    return np.asarray(np.gradient(of, dt, edge_order=2) if len(of) > 2 else np.zeros(len(of)))


def on_gpu(asked: Task) -> Array:
    """Forces and other columns (sets, columns, n); as many sets at once as the memory holds."""
    device = first_device()
    function = kernels(device, "records", asked.law, asked.free)
    n, columns = asked.record.n, asked.record.columns
    each = 8 * (asked.params.shape[1] + n * (columns + _ROOM * asked.moved))
    out = np.empty((len(asked.params), columns, n))
    with Current(device):
        free, _ = checked(driver.cuMemGetInfo())
        most = int(_SHARE * free / each)
        if most < 1:
            raise InputError(f"{device.name}: a set needs {each / 2**20:.0f} MiB; {free / 2**20:.0f} are free")
        for first in range(0, len(out), most):
            made, taken = out[first : first + most], list[Any]()

            def put(array: NDArray[Any], taken: list[Any] = taken) -> int:
                taken.append(checked(driver.cuMemAlloc(max(array.nbytes, 1))))
                checked(driver.cuMemcpyHtoD(taken[-1], np.ascontiguousarray(array).ctypes.data, array.nbytes))
                return int(taken[-1])

            try:
                asked.run(lambda record: function.launch("run", record, record.sets), put, made, first)
                checked(driver.cuMemcpyDtoH(made.ctypes.data, taken[-1], made.nbytes))  # waits for the kernel
            finally:
                for address in taken:
                    checked(driver.cuMemFree(address))
    return out
