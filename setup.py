"""Build what pyproject.toml cannot state: the page's bundle, service/viewer/static/bundle, and the compiled kernels.

three.js and Swagger UI come from npm, at the versions of service/viewer/package-lock.json.
Beside each large text there is the same compressed, which the service sends to browsers that accept gzip.
Without npm the package is built without the bundle, and the service says so at `/`. Without a C compiler and Python's
headers, and for a Python without its lock, it is built without the kernels: NumPy computes the points, more slowly, and
`hof doctor` says so.
"""

import gzip
import json
import shutil
import subprocess
import sysconfig
from pathlib import Path
from typing import Final

from setuptools import Extension, setup
from setuptools.command.build_py import build_py

ROOT: Final = Path(__file__).resolve().parent
VIEWER: Final = ROOT / "service" / "viewer"
MODULES: Final = VIEWER / "node_modules"
BUNDLE: Final = VIEWER / "static" / "bundle"

COMPRESSED: Final = (".js", ".css")

SHARED: Final = Path("service/mapping/kernel/arguments.h")
HAS_LIMITED_API: Final = not sysconfig.get_config_var("Py_GIL_DISABLED")


def _extension(name: str, source: Path, contract: str) -> Extension:
    """Return an extension whose headers lie beside its source; `contract` says how the compiler may contract sums."""
    return Extension(
        name,
        [str(source)],
        depends=[str(header) for header in {SHARED, *source.parent.glob("*.h")}],
        define_macros=[("Py_LIMITED_API", "0x030B0000")],  # one build for Python 3.11 and all later ones
        extra_compile_args=["-O3", f"-ffp-contract={contract}", "-fno-trapping-math", "-g0"],
        py_limited_api=True,
        optional=True,
    )


EXTENSIONS: Final = [
    _extension("service.mapping._kernel", Path("service/mapping/kernel/kernel.c"), "fast"),
    _extension("service.encoding._pixels", Path("service/encoding/kernel/pixels.c"), "off"),  # Pillow's bits
]

FILES: Final = {
    "three": (
        MODULES / "three",
        "LICENSE",
        "build/three.core.min.js",
        "build/three.module.min.js",
        "examples/jsm/controls/OrbitControls.js",
    ),
    "swagger-ui": (MODULES / "swagger-ui-dist", "LICENSE", "NOTICE", "swagger-ui-bundle.js", "swagger-ui.css"),
}


class BuildWithBundle(build_py):
    """Build of the Python files and of the bundle beside them, for wheels and editable installs alike."""

    def run(self) -> None:
        """Install missing npm packages, copy the files that the page uses, and build."""
        npm = shutil.which("npm")
        if npm and _versions(MODULES / ".package-lock.json") != _versions(VIEWER / "package-lock.json"):
            subprocess.run([npm, "ci", "--no-audit", "--no-fund"], cwd=VIEWER, check=True)  # noqa: S603
        if MODULES.is_dir():
            _copy()
        super().run()


def _versions(lock: Path) -> dict[str, str]:
    """Return the packages of an npm lock file and their versions; none if there is no file."""
    packages = json.loads(lock.read_text("utf-8"))["packages"] if lock.is_file() else {}
    return {name: package["version"] for name, package in packages.items() if name}


def _copy() -> None:
    shutil.rmtree(BUNDLE, ignore_errors=True)
    for folder, (source, *files) in FILES.items():
        (BUNDLE / folder).mkdir(parents=True)
        for file in files:
            copy = Path(shutil.copy(source / file, BUNDLE / folder))
            if copy.suffix in COMPRESSED:
                copy.with_name(f"{copy.name}.gz").write_bytes(gzip.compress(copy.read_bytes(), mtime=0))


setup(
    cmdclass={"build_py": BuildWithBundle},
    ext_modules=EXTENSIONS if HAS_LIMITED_API else [],
    options={"bdist_wheel": {"py_limited_api": "cp311"}} if HAS_LIMITED_API else {},
)
