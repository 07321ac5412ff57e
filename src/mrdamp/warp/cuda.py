"""The chain as GPU code: its C++ sources, compiled by NVRTC at run time for one law and the attributes in use.

Compiled code is kept in `$XDG_CACHE_HOME/mrdamp` (default `~/.cache/mrdamp`), by the hash of sources, options and
compiler. Compiling needs no GPU.
"""

from __future__ import annotations

import ctypes
import functools
import hashlib
import os
from pathlib import Path
from typing import Any

from mrdamp.errors import InputError
from mrdamp.files import write_atomic
from mrdamp.warp.native import fields, sources

try:
    from cuda.bindings import driver, nvrtc
except ImportError as error:
    raise InputError("dampers on a GPU need the extra `cuda`: pip install 'mrdamp[cuda]'") from error

#: Bytes of a thread's stack: the compiler cannot bound that of the chain's nested solves.
_STACK = 16384
_BLOCK = 64  # threads
_OPTIONS = ("-std=c++17", "-default-device", "-diag-suppress=20044")


def compiled(law_type: str, free: tuple[int, ...], dampers: int, arch: int) -> bytes:
    """Code for a GPU of compute capability `arch` (80: 8.0). law_type: the law's name in C++, as BoucWen. Raises
    InputError with the compiler's first line."""
    root, text = sources(), fields(free)
    definitions = (f"-DMRDAMP_PACK_LAW=k{law_type}", "-DMRDAMP_FIELDS", f"-DMRDAMP_DAMPERS={dampers}")
    options = (*_OPTIONS, *definitions, f"-arch=sm_{arch}")
    kept = _cache(root, "\n".join((text, *options)))
    if kept.is_file():
        return kept.read_bytes()
    main = (root / "device" / "worlds.cu").read_bytes()
    program = _checked(nvrtc.nvrtcCreateProgram(main, b"worlds.cu", 1, [text.encode()], [b"core/fields.h"]))
    given = [o.encode() for o in (*options, f"-I{root / 'device' / 'std'}", f"-I{root}")]
    (result,) = nvrtc.nvrtcCompileProgram(program, len(given), given)
    if result != nvrtc.nvrtcResult.NVRTC_SUCCESS:
        log = b" " * _checked(nvrtc.nvrtcGetProgramLogSize(program))
        nvrtc.nvrtcGetProgramLog(program, log)
        raise InputError(f"the GPU's compiler: {log.decode(errors='replace').strip().splitlines()[0]}")
    code: bytes = b" " * _checked(nvrtc.nvrtcGetCUBINSize(program))
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


def _checked(answer: tuple[Any, ...]) -> Any:
    """What a call of the driver or the compiler returns; raises InputError with its error's name."""
    error, *values = answer
    if int(error) != 0:
        raise InputError(f"CUDA: {error.name}")
    return values[0] if len(values) == 1 else tuple(values)


class Kernels:
    """The kernels `act` and `read` on a Warp device. Raises InputError for a card or driver that cannot run them."""

    def __init__(self, device: Any, law_type: str, free: tuple[int, ...], dampers: int) -> None:
        if device.arch < 70:
            raise InputError(f"{device.name}: compute capability {device.arch / 10:.1f}; dampers need 7.0")
        self.device = device
        code = compiled(law_type, free, dampers, device.arch)
        with _Current(device):
            limit = driver.CUlimit.CU_LIMIT_STACK_SIZE
            _checked(driver.cuCtxSetLimit(limit, max(_STACK, _checked(driver.cuCtxGetLimit(limit)))))
            self.module = _checked(driver.cuModuleLoadData(code))
            self.functions = {
                name: _checked(driver.cuModuleGetFunction(self.module, name.encode())) for name in ("act", "read")
            }

    def launch(self, what: str, worlds: ctypes.Structure, count: int, stream: int) -> None:
        """Over `count` worlds, on a CUDA stream; joins a graph that is captured there."""
        argument = (ctypes.c_void_p * 1)(ctypes.addressof(worlds))
        grid = (count + _BLOCK - 1) // _BLOCK
        with _Current(self.device):
            _checked(
                driver.cuLaunchKernel(
                    self.functions[what], grid, 1, 1, _BLOCK, 1, 1, 0, stream, ctypes.addressof(argument), 0
                )
            )


class _Current:
    """The device's context as the current one."""

    def __init__(self, device: Any) -> None:
        self.context = driver.CUcontext(int(device.context))

    def __enter__(self) -> None:
        _checked(driver.cuCtxPushCurrent(self.context))

    def __exit__(self, *_: object) -> None:
        _checked(driver.cuCtxPopCurrent())


@functools.cache
def kernels(device: Any, law_type: str, free: tuple[int, ...], dampers: int) -> Kernels:
    """One for each device, law and set of attributes."""
    return Kernels(device, law_type, free, dampers)
