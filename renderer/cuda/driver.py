"""NVIDIA's driver through ctypes: those functions of its public C API that rendering needs, without CUDA's toolkit.

Each function raises DriverError with the driver's own name and description of the error. A `Device` may be used by any thread,
but only by one at a time.
"""

from __future__ import annotations

import ctypes
import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    import numpy.typing as npt

__all__ = ["LIBRARY", "Card", "Device", "Driver", "DriverError", "Kernel"]

LIBRARY = "libcuda.so.1"
_MAJOR, _MINOR, _PROCESSORS = 75, 76, 16  # CU_DEVICE_ATTRIBUTE_...
_LOG, _LOG_BYTES = 5, 6  # CU_JIT_ERROR_LOG_BUFFER and its size
_LOG_SIZE = 8192
_NAME_SIZE = 256
_UUID_SIZE = 16
_MODULE_FILE = "/proc/driver/nvidia/version"  # missing in Windows' subsystem for Linux
_Pointer = ctypes.c_uint64  # CUdeviceptr
Kernel = ctypes.c_void_p  # CUfunction


class DriverError(Exception):
    """Raised if the driver is missing or one of its functions failed.

    code: the driver's name of the error, empty if it has none.
    """

    def __init__(self, text: str, code: str = "") -> None:
        super().__init__(text)
        self.code = code


class Card(NamedTuple):
    """The properties of a graphics card, as reported by the driver."""

    number: int
    name: str
    capability: tuple[int, int]
    memory: int  # bytes
    processors: int  # streaming multiprocessors
    uuid: str = ""
    driver: str = ""  # the driver's version, with the newest version of CUDA that it supports


class Driver:
    """NVIDIA's driver library, loaded and initialised. Raises DriverError if no driver is installed."""

    def __init__(self, library: str = LIBRARY) -> None:
        try:
            self._library = ctypes.CDLL(library)
        except OSError as error:
            raise DriverError(f"the NVIDIA driver's library cannot be loaded: {error}") from error
        self.call("cuInit", ctypes.c_uint(0))

    def call(self, function: str, *arguments: Any) -> None:
        """Calls a function of the driver by name. Raises DriverError if it fails."""
        try:
            called = getattr(self._library, function)
        except AttributeError as error:
            raise DriverError(f"the NVIDIA driver lacks the function {function}") from error
        if code := called(*arguments):
            name, text = self._error_texts(code)
            raise DriverError(f"{function} failed: {text} ({name})", name)

    def _error_texts(self, code: int) -> tuple[str, str]:
        """Returns the driver's name and description of an error code."""
        texts = []
        for function in ("cuGetErrorName", "cuGetErrorString"):
            text = ctypes.c_char_p()
            getattr(self._library, function)(ctypes.c_int(code), ctypes.byref(text))
            texts.append((text.value or f"error {code}".encode()).decode(errors="replace"))
        return texts[0], texts[1]

    def version(self) -> tuple[int, int]:
        """Returns the newest version of CUDA that the driver supports: (major, minor)."""
        number = ctypes.c_int()
        self.call("cuDriverGetVersion", ctypes.byref(number))
        return number.value // 1000, number.value % 1000 // 10

    def cards(self) -> list[Card]:
        """Returns all graphics cards, whatever their compute capability, in the driver's order."""
        count = ctypes.c_int()
        self.call("cuDeviceGetCount", ctypes.byref(count))
        driver = f"{_module_version()} (CUDA {'.'.join(map(str, self.version()))})"
        return [self._card(number, driver) for number in range(count.value)]

    def handle(self, number: int) -> ctypes.c_int:
        """Returns the driver's handle of the graphics card with this number."""
        handle = ctypes.c_int()
        self.call("cuDeviceGet", ctypes.byref(handle), ctypes.c_int(number))
        return handle

    def _card(self, number: int, driver: str) -> Card:
        handle = self.handle(number)
        name = ctypes.create_string_buffer(_NAME_SIZE)
        self.call("cuDeviceGetName", name, ctypes.c_int(_NAME_SIZE), handle)
        memory = ctypes.c_size_t()
        self.call("cuDeviceTotalMem_v2", ctypes.byref(memory), handle)
        major, minor, processors = (self._attribute(which, handle) for which in (_MAJOR, _MINOR, _PROCESSORS))
        uuid = ctypes.create_string_buffer(_UUID_SIZE)
        self.call("cuDeviceGetUuid", uuid, handle)
        return Card(number, name.value.decode(errors="replace"), (major, minor), memory.value, processors, uuid.raw.hex(), driver)

    def _attribute(self, attribute: int, handle: ctypes.c_int) -> int:
        value = ctypes.c_int()
        self.call("cuDeviceGetAttribute", ctypes.byref(value), ctypes.c_int(attribute), handle)
        return value.value


def _module_version() -> str:
    """Returns the version of NVIDIA's kernel module, which is that of the driver; "?" if it is unknown."""
    try:
        found = re.search(r"\b\d+\.\d+(?:\.\d+)?\b", Path(_MODULE_FILE).read_text())
    except (OSError, UnicodeError):
        found = None
    return found[0] if found else "?"


class Device:
    """An open graphics card: allocates its memory and launches its kernels, in its primary context.

    Must be closed to release them.
    """

    def __init__(self, driver: Driver, number: int) -> None:
        self._driver = driver
        self._handle = driver.handle(number)
        self._allocated: set[int] = set()
        self._modules: list[ctypes.c_void_p] = []
        context = ctypes.c_void_p()
        driver.call("cuDevicePrimaryCtxRetain", ctypes.byref(context), self._handle)
        self._context = context

    def _call_in_context(self, function: str, *arguments: Any) -> None:
        """Calls a function of the driver in the calling thread with this card's context. Raises DriverError if it fails."""
        self._driver.call("cuCtxSetCurrent", self._context)
        self._driver.call(function, *arguments)

    def upload(self, array: npt.NDArray[Any]) -> int:
        """Copies a C-contiguous array to newly allocated GPU memory; returns its address there."""
        address = self.allocate(array.nbytes)
        if array.nbytes:
            source = ctypes.c_void_p(array.ctypes.data)
            self._call_in_context("cuMemcpyHtoD_v2", _Pointer(address), source, ctypes.c_size_t(array.nbytes))
        return address

    def allocate(self, size: int) -> int:
        """Allocates GPU memory of `size` bytes, not initialised; returns its address."""
        address = _Pointer()
        self._call_in_context("cuMemAlloc_v2", ctypes.byref(address), ctypes.c_size_t(max(size, 1)))
        self._allocated.add(address.value)
        return address.value

    def clear(self, address: int, size: int) -> None:
        """Sets `size` bytes of GPU memory at `address` to 0."""
        if size:
            self._call_in_context("cuMemsetD8_v2", _Pointer(address), ctypes.c_ubyte(0), ctypes.c_size_t(size))

    def download(self, address: int, array: npt.NDArray[Any]) -> None:
        """Copies GPU memory at `address` into a C-contiguous array, after the kernels launched before have ended."""
        if array.nbytes:
            target = ctypes.c_void_p(array.ctypes.data)
            self._call_in_context("cuMemcpyDtoH_v2", target, _Pointer(address), ctypes.c_size_t(array.nbytes))

    def free(self, address: int) -> None:
        """Frees memory allocated by `allocate` or `upload`."""
        self._allocated.discard(address)
        self._call_in_context("cuMemFree_v2", _Pointer(address))

    def load(self, ptx: str, names: Sequence[str]) -> dict[str, Kernel]:
        """Translates PTX for this graphics card, or loads it from the driver's disk cache; returns its kernels by name."""
        log = ctypes.create_string_buffer(_LOG_SIZE)
        options = (ctypes.c_int * 2)(_LOG, _LOG_BYTES)
        values = (ctypes.c_void_p * 2)(ctypes.addressof(log), _LOG_SIZE)
        module = ctypes.c_void_p()
        text = ctypes.c_char_p(ptx.encode())
        try:
            self._call_in_context("cuModuleLoadDataEx", ctypes.byref(module), text, ctypes.c_uint(2), options, values)
        except DriverError as error:
            details = log.value.decode(errors="replace").strip()
            raise DriverError(f"{error}: {details}" if details else str(error), error.code) from error
        self._modules.append(module)
        kernels = {name: Kernel() for name in names}
        for name, kernel in kernels.items():
            self._call_in_context("cuModuleGetFunction", ctypes.byref(kernel), module, ctypes.c_char_p(name.encode()))
        return kernels

    def launch(self, kernel: Kernel, blocks: int, threads: int, arguments: Sequence[bytes]) -> None:
        """Launches a kernel with `blocks` blocks of `threads` threads; returns immediately."""
        buffers = [ctypes.create_string_buffer(argument, len(argument)) for argument in arguments]
        places = (ctypes.c_void_p * len(buffers))(*(ctypes.addressof(each) for each in buffers))
        sizes = (ctypes.c_uint(each) for each in (blocks, 1, 1, threads, 1, 1, 0))
        self._call_in_context("cuLaunchKernel", kernel, *sizes, None, places, None)

    def synchronize(self) -> None:
        """Waits until all launched kernels have ended. Raises DriverError if one failed."""
        self._call_in_context("cuCtxSynchronize")

    def close(self) -> None:
        """Frees all memory and kernels on the graphics card."""
        for address in list(self._allocated):
            self.free(address)
        while self._modules:
            self._call_in_context("cuModuleUnload", self._modules.pop())
        self._driver.call("cuDevicePrimaryCtxRelease_v2", self._handle)
