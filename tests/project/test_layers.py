"""Imports point one way, and the service needs what it declares and nothing else: no torch."""

import ast
import subprocess
import sys
from collections.abc import Iterator
from importlib.metadata import Distribution, distribution
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).parents[2]
OURS = ("service", "model", "tests", "benchmarks", "demo")
RUN_TIMEOUT_S = 120

# What a module may import of ours, by the longest of these names that it begins with. Other modules of service/
# import each other as they like.
ALLOWED = {
    "model": {
        "model",
        "service.mapping.canonical",
        "service.mapping.color",
        "service.encoding.encoder",
        "service.errors",
        "service.files",
        "service.formats",
        "service.encoding.framing",
        "service.mapping",
        "service.drawing.cloud",
        "service.mapping.sampler",
        "service.drawing.words",
        "service.mapping.surface",
    },
    "service": {"service"},
    "service.errors": set(),
    "service.files": set(),
    "service.mapping": {"service.errors"},
    "service.encoding.framing": {"service.errors"},
    "service.mapping.compiled": set(),
    "service.mapping.canonical": {"service.errors", "service.mapping.compiled", "service.mapping"},
    "service.mapping.folding": {"service.mapping.canonical", "service.mapping.compiled", "service.mapping"},
    "service.mapping.sampler": {
        "service.mapping.canonical",
        "service.errors",
        "service.mapping.folding",
        "service.mapping",
    },
    "service.mapping.color": {
        "service.mapping.canonical",
        "service.errors",
        "service.mapping",
        "service.mapping.sampler",
    },
    "service.mapping.surface": {"service.mapping.color", "service.mapping", "service.mapping.sampler"},
    "service.encoding.matting": {"service.encoding.encoder", "service.errors"},
    "service.encoding.encoder": {"service.errors", "service.encoding.framing", "service.mapping"},
    "service.formats": {
        "service.errors",
        "service.formats",
        "service.mapping",
        "service.mapping.sampler",
        "service.mapping.surface",
    },
    "service.drawing.cloud": {"service.mapping"},
    "service.drawing.words": {"service.mapping", "service.drawing.cloud"},
    "service.api.routes.viewer": {"service.errors"},
    "service.migrations": {"service.errors"},
    "service.storage.database": {"service.errors", "service.migrations"},
    "service.storage.store": {"service.storage.database", "service.errors", "service.mapping"},
    "service.runtime.composition": {
        "service.errors",
        "service.formats",
        "service.storage.ids",
        "service.mapping",
        "service.runtime.streaming",
        "service.storage.store",
    },
    "service.encoding.registry": {"service.encoding.encoder", "service.errors"},
    "service.settings": {"service.encoding.framing"},
    "service.telemetry.logs": {"service.settings"},
    "service.api.middleware.observe": {"service.telemetry.logs", "service.telemetry.metrics"},
    "service.api.middleware.security_headers": set(),
    "service.server.http_protocol": {
        "service.errors",
        "service.api.middleware.security_headers",
        "service.api.problems",
    },
    "service.api.keys": {"service.errors"},
    "service.api.middleware.access": {
        "service.runtime.admission",
        "service.errors",
        "service.api.keys",
        "service.api.problems",
        "service.settings",
    },
    "service.telemetry.tracing": set(),
    "demo": {"service.drawing.cloud"},
}


def _modules(*folders: str) -> Iterator[tuple[str, ast.Module]]:
    for folder in folders:
        for path in sorted((ROOT / folder).rglob("*.py")):
            name = ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")
            yield name, ast.parse(path.read_text("utf-8"))


def _imported(tree: ast.AST) -> Iterator[str]:
    """Every module that is imported anywhere in a tree, dotted; of `from a import b`, a.b too."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "relative imports hide where they point"
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def _within(name: str, packages: set[str]) -> bool:
    return any(name == package or name.startswith(f"{package}.") for package in packages)


def _rule(module: str) -> set[str]:
    return ALLOWED[max((name for name in ALLOWED if _within(module, {name})), key=len)]


@pytest.mark.parametrize("folder", ["service", "model", "demo"])
def test_imports_point_one_way(folder: str) -> None:
    modules = list(_modules(folder))
    assert modules
    for module, tree in modules:
        own = {name for name in _imported(tree) if name.split(".")[0] in OURS}
        wrong = {name for name in own if not _within(name, _rule(module))}
        assert not wrong, f"{module} imports {wrong}"


def test_the_service_names_no_torch() -> None:
    for module, tree in _modules("service", "demo"):
        assert "torch" not in {name.split(".")[0] for name in _imported(tree)}, module


def test_every_rule_names_modules_that_exist() -> None:
    names = {name for name, _ in _modules("service", "model", "demo")} | {"demo"}
    assert (set(ALLOWED) | set().union(*ALLOWED.values())) <= names


def _required(name: str, extras: frozenset[str] = frozenset()) -> dict[str, Distribution]:
    """A distribution and all that it requires here, as pip would install them."""
    name = canonicalize_name(name)
    found: dict[str, Distribution] = {name: distribution(name)}
    for requirement in map(Requirement, found[name].requires or ()):
        marker = requirement.marker
        if marker is None or any(marker.evaluate({"extra": extra}) for extra in extras | {""}):
            found |= _required(requirement.name, frozenset(requirement.extras))
    return found


@pytest.fixture
def site(tmp_path: Path) -> Path:
    """A folder of packages that holds the service, and of what is installed only what the service requires."""
    folder = tmp_path / "site"
    folder.mkdir()
    (folder / "service").symlink_to(ROOT / "service")
    for name, found in _required("hof").items():
        tops = {file.parts[0] for file in found.files or () if file.parts[0] not in ("..", "__pycache__")}
        for top in tops if name != "hof" else ():
            (folder / top).symlink_to(Path(str(found.locate_file(top))))
    return folder


BARE = """
import sys
sys.path = [sys.argv.pop(1), *(path for path in sys.path if "site-packages" not in path)]
from service.cli.main import main
status = main(sys.argv[1:])
assert not {"torch", "model", "onnx", "scipy", "safetensors"} & set(sys.modules)
sys.exit(status)
"""


@pytest.mark.parametrize("command", ["encode photo.png -o points.glb", "openapi"])
def test_the_service_runs_on_its_own_requirements(
    site: Path, tmp_path: Path, model_path: Path, photo: bytes, command: str
) -> None:
    (tmp_path / "photo.png").write_bytes(photo)
    run = subprocess.run(
        [sys.executable, "-I", "-S", "-c", BARE, str(site), *command.split()],
        cwd=tmp_path,
        env={"HOF_MODEL": str(model_path)},
        capture_output=True,
        text=True,
        timeout=RUN_TIMEOUT_S,
        check=False,
    )
    assert (run.returncode, run.stderr) == (0, "")
    assert run.stdout == ((ROOT / "openapi.json").read_text() if command == "openapi" else "")
