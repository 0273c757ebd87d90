"""The import of numba, all changes to it and all uses of its private parts.

numba is imported only here: on import and at every compilation it reads `.numba_config.yaml` of the
working folder, which may name a folder of code.

Each change was tested with numba 0.68.1 (`TRIED_WITH`) and is valid from 0.61 on while the replaced
source is unchanged: `tests/harvester/base/test_numba_patches.py` compares its digest with
`REPLACED` and fails if numba has changed it. Then read the new source, check that the patch still
works as documented, and enter the new digest here.

==================================  ==============================================================
what                                why
==================================  ==============================================================
`keep_own_index`                    numba fails on a cache with classes of a program that has been
                                    removed, and a damaged file may end the process
`name_by_sources`                   numba compares the function's own file alone, not the files of
                                    the functions that it calls
`load_alone`                        numba fills tables and imports modules that only compiling
                                    needs, scipy among them
`wait_for_other_processes`          workers that begin together would all compile the same
`read_no_settings_file`             a file of the working folder may name a folder of code
`ziggurat`                          numba's copy of numpy's tables: the same normal numbers
`UNCOUNTED`, `INLINE`, `WITHIN`     options of the compiler without a public name, in
                                    `harvester.base.compilation`; numba refuses an option that it
                                    does not have as soon as one is used
==================================  ==============================================================
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import inspect
import pickle
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from harvester.base import numba_cache
from harvester.base.surroundings import away_from_working_folder

numba_cache.keep_environment_usable()
with away_from_working_folder():
    import llvmlite.binding
    import numba
    from numba import carray, cfunc, extending, njit, types
    from numba.core import caching, cgutils, dispatcher, environment
    from numba.core.compiler_lock import global_compiler_lock
    from numba.core.runtime import rtsys
    from numba.extending import intrinsic
    from numba.np.random import _constants as ziggurat

__all__ = [
    "CACHED", "REPLACED", "TRIED_WITH", "carray", "cfunc", "cgutils", "extending", "intrinsic",
    "njit", "numba", "types", "ziggurat",
]  # fmt: skip
TRIED_WITH = "0.68.1"


def digest_of(part: Any) -> str:
    """Digest of the source of a class or function, to detect changes."""
    return hashlib.sha256(inspect.getsource(part).encode()).hexdigest()[:16]


# Functions of numba before they are replaced or derived from.
ORIGINAL = {
    "numba.core.caching.IndexDataCacheFile": caching.IndexDataCacheFile,
    "numba.core.caching.Cache._index_key": caching.Cache._index_key,
    "numba.core.caching.Cache.load_overload": caching.Cache.load_overload,
    "numba.core.dispatcher.Dispatcher.compile": dispatcher.Dispatcher.compile,
    "numba.core.environment._rebuild_env": environment._rebuild_env,
}
# Digests of the originals' source in the release with which the patches were tested.
REPLACED = {
    "numba.core.caching.IndexDataCacheFile": "953c3b4c113b8f4d",
    "numba.core.caching.Cache._index_key": "c861935e10096c3c",
    "numba.core.caching.Cache.load_overload": "49a98e578d710b9b",
    "numba.core.dispatcher.Dispatcher.compile": "0ab4aee15e79bb1d",
    "numba.core.environment._rebuild_env": "f946d544aa9ef65e",
}


def read_no_settings_file() -> None:
    """Keep numba from reading `.numba_config.yaml` of the working folder whenever it compiles."""
    # An empty name: no settings file is read.
    numba.core.config._config_fname = ""


def keep_own_index() -> None:
    """Limit numba's cache to types of this program, and reject damaged files.

    An index is read as a whole: a type of a missing module would make numba fail. If a digest does
    not match, code is compiled again, with a warning; a file that cannot be written is skipped.
    """

    class OwnIndex(caching.IndexDataCacheFile):
        def __init__(self, *arguments, **options):
            super().__init__(*arguments, **options)
            # Files without digests count as files of another version.
            self._version += ", with digests"

        def save(self, key, data):
            key, digest = key
            if not numba_cache.is_foreign(key[0]):
                with contextlib.suppress(OSError):
                    super().save(key, (digest, data))

        def load(self, key):
            key, digest = key
            stored = super().load(key)
            return stored[1] if stored and stored[0] == digest else None

        def _dump(self, obj):
            content = super()._dump(obj)
            return hashlib.sha256(content).digest() + content

        def _load_index(self):
            content = numba_cache.plain_file(self._index_path)
            if content is None:
                return {}
            version = pickle.dumps(self._version, protocol=-1)
            if not content.startswith(version):
                if not numba_cache.begins_with_text(content):
                    numba_cache.on_damage(self._index_path)
                return {}
            index = numba_cache.unpickled(content[len(version) :], self._index_path)
            stamp, overloads = (None, None) if index is None else index
            return overloads if stamp == self._source_stamp else {}

        def _load_data(self, name):
            path = self._data_path(name)
            content = numba_cache.plain_file(path)
            return None if content is None else numba_cache.unpickled(content, path)

    caching.IndexDataCacheFile = OwnIndex


def name_by_sources() -> None:
    """Use cached code only if none of its source files has changed.

    Otherwise an unchanged integrator would keep an old force law. Code of unrelated files remains
    valid.
    """
    name_alone = caching.Cache._index_key

    @functools.wraps(name_alone)
    def index_key(self, sig, codegen):
        sources = numba_cache.sources({self._py_func.__module__, *numba_cache.modules_of(sig)})
        digest = hashlib.sha256(repr(sorted(sources.items())).encode()).digest()
        return name_alone(self, sig, codegen), digest

    caching.Cache._index_key = index_key


def load_alone() -> None:
    """Load cached code without numba's tables of all functions and without the modules of the
    functions that it calls: only compiling needs them.

    A process that compiles nothing starts 0.3 s sooner.
    """

    def load_overload(self, sig, target_context):
        rtsys.initialize(target_context)
        with self._guard_against_spurious_io_errors():
            return self._load_overload(sig, target_context)

    def named(module):
        # Compiled code reads no global variable; by the name numba knows what may be cached.
        return SimpleNamespace(__name__=module)

    caching.Cache.load_overload = load_overload
    # `_rebuild_env` imports the module of each function that compiled code contains.
    environment.importlib = SimpleNamespace(import_module=named)


def wait_for_other_processes() -> None:
    """Make a process wait for code that another process is compiling, and load that code.

    Otherwise workers that start together would all compile the same code for seconds.
    """
    compile_now = dispatcher.Dispatcher.compile

    @functools.wraps(compile_now)
    def compile_once(self, signature):
        if isinstance(self._cache, caching.NullCache):
            return compile_now(self, signature)
        name = f"{self.py_func.__module__}.{self.py_func.__qualname__}{signature}"
        # The lock within the process comes first, so that only one thread waits for other
        # processes.
        numba_cache.on_compilation(1)
        try:
            with global_compiler_lock, numba_cache.alone(Path(self._cache.cache_path), name):
                return compile_now(self, signature)
        finally:
            numba_cache.on_compilation(-1)

    dispatcher.Dispatcher.compile = compile_once  # type: ignore[method-assign, assignment]


read_no_settings_file()
# Vectors of eight numbers if the processor has them: by default LLVM uses four on some of these.
if not numba.core.config.CPU_FEATURES:
    features = llvmlite.binding.get_host_cpu_features()
    if features.get("avx512f"):
        numba.core.config.CPU_FEATURES = features.flatten() + ",-prefer-256-bit"
keep_own_index()
name_by_sources()
load_alone()
wait_for_other_processes()
# Without the cache everything is compiled at every start, which takes some seconds.
CACHED = numba_cache.is_safe()
