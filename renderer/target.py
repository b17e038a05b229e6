"""The compile target of Rayfarm's kernels: Numba's CPU target with its own CPU name, optimisation options and registries.

Numba reads such options from one configuration for the whole process, which belongs to the host program. Therefore kernels do not
use the target "cpu": they are dispatched by `KernelDispatcher`, whose contexts and code generator are separate instances. The
host program's `@njit` functions keep their options, their cache and their machine code (tests/renderer/test_target.py).
"""

from __future__ import annotations

import functools
from typing import Any

from numba import jit, types
from numba.core import typing
from numba.core.codegen import JITCPUCodegen
from numba.core.cpu import CPUContext
from numba.core.registry import CPUDispatcher, CPUTarget, cpu_target
from numba.core.runtime import rtsys
from numba.core.target_extension import CPU, dispatcher_registry, jit_registry, target_override, target_registry
from numba.core.utils import threadsafe_cached_property

from renderer import cpu

__all__ = ["NAME", "KernelDispatcher"]

NAME = "rayfarm"
# Kernels use explicit SIMD. LLVM's vectorisers and its third level of optimisation take a fifth of the time that
# a cold kernel takes to compile, and make none faster (measured).
_OPTIMISATION = {"opt": 2, "loop_vectorize": False, "slp_vectorize": False}


class KernelCPU(CPU):
    """The key of this target in Numba's registries. Declarations for "cpu" or "generic" apply to it."""


class _Codegen(JITCPUCodegen):
    """Generates code for the CPU of renderer/cpu.py, regardless of NUMBA_CPU_NAME, NUMBA_CPU_FEATURES and NUMBA_OPT."""

    def _get_host_cpu_name(self) -> str:
        return cpu.NAME

    def _get_host_cpu_features(self) -> str:
        return cpu.FEATURES

    def _customize_tm_options(self, options: dict[str, Any]) -> None:
        super()._customize_tm_options(options)
        options["opt"] = _OPTIMISATION["opt"]

    def _pass_builder(self, **options: Any) -> Any:
        return super()._pass_builder(**{**_OPTIMISATION, **options})


class _TypingContext(typing.Context):
    """The typing context: finds the signature of a call from its argument types.

    Numba tries some ten templates per operation, those of datetime64 before those of numbers, and types each function at least
    twice. This context
    caches the signatures, which saves an eighth of the time to compile kernels (measured).
    """

    def __init__(self) -> None:
        self._signatures: dict[tuple[Any, tuple[types.Type, ...]], Any] = {}
        super().__init__()

    def resolve_function_type(self, func: Any, args: Any, kws: Any) -> Any:
        """Returns the signature of a call, or None. Caches the signatures of operators, intrinsics and Numba's own functions.

        Signatures of functions that are compiled at their first call are cached by Numba itself.
        """
        if kws or isinstance(func, str) or (isinstance(func, types.Type) and not isinstance(func, types.Function)):
            return super().resolve_function_type(func, args, kws)
        key = func, args
        if key not in self._signatures:
            found = super().resolve_function_type(func, args, kws)
            if found is None:
                return None
            self._signatures[key] = found
        return self._signatures[key]


class _Context(CPUContext):
    """The target context: lowers typed code and generates machine code."""

    enable_boundscheck = False  # overrides NUMBA_BOUNDSCHECK: the cache has one version of each function

    def init(self) -> None:
        """Sets up the code generator."""
        super().init()
        self._internal_codegen = _Codegen("rayfarm.exec")

    def prepare_to_load(self) -> None:
        """Registers the symbols to which compiled code links.

        Initialises the runtime that all targets share, for "cpu", as Numba does without kernels. Does not load Numba's
        declarations, which are needed for compiling only and take three quarters of the time to load a kernel (measured).
        """
        rtsys.initialize(cpu_target.target_context)

    def load_additional_registries(self) -> None:
        """Loads Numba's declarations of types and functions."""
        self.prepare_to_load()
        super().load_additional_registries()


class _Target(CPUTarget):
    @threadsafe_cached_property
    def typing_context(self) -> _TypingContext:
        """Returns the typing context that all threads share."""
        return _TypingContext()

    @threadsafe_cached_property
    def target_context(self) -> _Context:
        """Returns the target context that all threads share."""
        return _Context(self.typing_context, NAME)


class KernelDispatcher(CPUDispatcher):
    """The dispatcher of kernels: compiles a function for this target when it is called."""

    targetdescr = _Target(NAME)

    def keep_in(self, cache: Any) -> None:
        """Sets the on-disk cache of the function's compiled code."""
        self._cache = cache

    def compile(self, sig: Any) -> Any:
        """Compiles the function for a signature, or loads it from the cache. Functions that it calls get the same target."""
        with target_override(NAME):
            return super().compile(sig)


target_registry[NAME] = KernelCPU
dispatcher_registry[KernelCPU] = KernelDispatcher
jit_registry[KernelCPU] = functools.partial(jit, _target=NAME)
