"""What pyproject.toml cannot say, because it depends on the interpreter and on whether there is a compiler.

The extension is optional: without a C compiler the package installs, and the numpy twins do the work. Python's own flags bring
-fwrapv, which makes every index wrap at 32 bits: the inner loops lost half their speed to it.
"""

import platform
import sysconfig

from setuptools import Extension, setup
from setuptools.command.bdist_wheel import bdist_wheel
from setuptools.command.build_ext import build_ext

FREE_THREADED = bool(sysconfig.get_config_var("Py_GIL_DISABLED"))  # it has no stable ABI, and setuptools refuses to pretend
X87 = platform.machine().lower() in ("i386", "i486", "i586", "i686", "x86")  # whose registers of 80 bits round otherwise
FLAGS = ["-O3", "-std=gnu11", "-fno-wrapv", "-fno-math-errno", "-fno-trapping-math", "-Wno-psabi"]
HEADERS = (
    "layout", "lanes", "segments", "hsmm", "exponential", "vectors", "path", "foresight",
    "law", "enter", "roles", "checker", "envelope", "guard", "ordinary", "beam", "rows", "carry",
)  # fmt: skip


class Built(build_ext):
    """Knows afterwards whether anything was compiled."""

    def run(self):
        super().run()
        if not any(path for path in map(self.get_ext_fullpath, (e.name for e in self.extensions)) if exists(path)):
            self.distribution.nothing_compiled = True


class Wheel(bdist_wheel):
    """A wheel in which nothing was compiled fits every platform, and says so: no machine with a compiler is kept from its own."""

    def run(self):
        if not self.skip_build and self.distribution.has_ext_modules():
            self.run_command("build_ext")
            if getattr(self.distribution, "nothing_compiled", False):
                self.distribution.ext_modules = []
                self.root_is_pure, self.py_limited_api = True, False
        super().run()


def exists(path):
    from pathlib import Path

    return Path(path).exists()


setup(
    ext_modules=[
        Extension(
            "comanip.kernels._native",
            sources=["src/comanip/kernels/_native.c"],
            depends=[f"src/comanip/kernels/_{name}.h" for name in HEADERS],
            extra_compile_args=[*FLAGS, *(["-msse2", "-mfpmath=sse"] if X87 else [])],
            extra_link_args=["-pthread"],
            py_limited_api=not FREE_THREADED,
            optional=True,
        )
    ],
    cmdclass={"bdist_wheel": Wheel, "build_ext": Built},
    options={} if FREE_THREADED else {"bdist_wheel": {"py_limited_api": "cp311"}},
)
