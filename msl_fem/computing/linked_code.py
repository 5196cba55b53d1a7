"""Compiled functions that only compiled functions call: kept as LLVM's code, optimised as a part of their callers."""

from typing import Any

from llvmlite import binding
from numba.core.codegen import JITCodeLibrary


class _NoEngine:
    """In the place of numba's code generator, for code that runs nowhere by itself."""

    def set_env(self, name: str, environment: Any) -> None: ...


class LinkedLibrary(JITCodeLibrary):
    """A function's code with that of all functions it calls, neither optimised together nor made machine code."""

    @property
    def codegen(self) -> Any:
        return _NoEngine()

    def finalize(self) -> None:
        self._raise_if_finalized()
        for library in dict.fromkeys(self._linking_libraries):
            self._reload_init.update(library._reload_init)
            self._final_module.link_in(library._get_module_for_linking(), preserve=True)
        self._final_module.verify()
        self._finalize_dynamic_globals()
        self._verify_declare_only_symbols()
        self._finalized = True

    def get_pointer_to_function(self, name: str) -> int:
        """0: there is no machine code."""
        return 0

    def serialize_using_object_code(self) -> tuple[str, str, bytes]:
        return self.serialize_using_bitcode()

    @classmethod
    def _unserialize(cls, codegen: Any, state: tuple[str, str, bytes]) -> "LinkedLibrary":
        name, _, code = state
        library = cls(codegen, name)
        library._final_module = binding.parse_bitcode(code)
        library._finalized = True
        return library


class WholeLibrary(JITCodeLibrary):
    """The code of a function that Python calls, with all that is linked into it."""

    def _optimize_final_module(self) -> None:
        """What was linked in is known to be called from here alone, so it may take the place of its calls.

        Private: it has no name by which other machine code, which calls it otherwise, could find it.
        """
        for function in self._final_module.functions:
            if not function.is_declaration and function.linkage == binding.Linkage.linkonce_odr:
                function.linkage = binding.Linkage.private
        super()._optimize_final_module()
