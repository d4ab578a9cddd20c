"""Settings: defaults, environment variables, and refused values."""

from pathlib import Path

import pytest
from pydantic import ValidationError

from service import settings as module
from service.settings import (
    SHIPPED_MATTING,
    SHIPPED_MODEL,
    Settings,
    available_cpus,
    default_matting_model,
    shipped_models,
)


@pytest.fixture(autouse=True)
def _no_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in Settings.model_fields:
        monkeypatch.delenv(f"HOF_{name.upper()}", raising=False)


def test_settings_by_default_serve_this_machine_with_the_shipped_model() -> None:
    settings = Settings()
    assert (settings.host, settings.port) == ("127.0.0.1", 8080)
    assert settings.model[0] == Path(module.__file__).parents[1] / "model" / "weights" / "hof1-k2.onnx"
    assert settings.database_url.startswith("sqlite:///")
    assert settings.database_url.endswith("hof/hof.db")
    assert settings.matting_model == default_matting_model()
    assert settings.threads == available_cpus()
    assert (settings.workers, settings.api_keys_file, settings.rate_limit, settings.cors_origins) == (
        1,
        None,
        None,
        None,
    )
    assert settings.log_format == "json"  # stderr is not a terminal here


def test_settings_by_default_load_every_shipped_model_the_default_one_first(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("z.onnx", "hof1-k2.onnx", "a.onnx", "README.md"):
        (tmp_path / name).touch()
    monkeypatch.setattr(module, "SHIPPED_MODEL", tmp_path / "hof1-k2.onnx")
    assert [path.name for path in Settings().model] == ["hof1-k2.onnx", "a.onnx", "z.onnx"]


def test_settings_model_is_split_at_commas_in_the_environment_only(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOF_MODEL", "a.onnx, b c.onnx,")
    assert Settings().model == (Path("a.onnx"), Path("b c.onnx"))
    assert Settings.model_validate({"model": ["a,b.onnx"]}).model == (Path("a,b.onnx"),)


def test_settings_model_by_name_is_the_shipped_file(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.chdir(tmp_path)
    assert Settings.model_validate({"model": ["hof1-k4"]}).model == (SHIPPED_MODEL.with_name("hof1-k4.onnx"),)
    for other in ("hof1-k4.onnx", "./hof1-k4.onnx", "folder/hof1-k4", "nothere"):
        assert Settings.model_validate({"model": [other]}).model == (Path(other),)
    (tmp_path / "hof1-k4").write_bytes(b"a file of this name wins")
    assert Settings.model_validate({"model": ["hof1-k4"]}).model == (Path("hof1-k4"),)


def test_settings_matting_model_defaults_to_the_best_one_there_is(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr("sys.prefix", str(tmp_path))
    assert Settings().matting_model == SHIPPED_MATTING
    assert SHIPPED_MATTING.is_file()
    assert SHIPPED_MATTING not in shipped_models()
    installed = tmp_path / "u2net" / "rembg" / "u2netp.onnx"
    installed.parent.mkdir(parents=True)
    installed.touch()
    assert Settings().matting_model == installed
    monkeypatch.setenv("U2NET_HOME", "/models")
    assert Settings().matting_model == Path("/models/u2netp.onnx")
    monkeypatch.setenv("U2NET_HOME", "")
    assert Settings().matting_model == SHIPPED_MATTING
    assert Settings(matting_model="none").matting_model is None  # type: ignore[arg-type]
    monkeypatch.setenv("HOF_MATTING_MODEL", "other.onnx")
    assert Settings().matting_model == Path("other.onnx")


def test_settings_from_the_environment_set_every_field(monkeypatch: pytest.MonkeyPatch) -> None:
    values = {
        "host": "0.0.0.0",
        "port": 9,
        "database_url": "sqlite:///x.db",
        "database_timeout_s": 2.5,
        "database_connections": 10,
        "model": (Path("m.onnx"),),
        "matting_model": Path("u.onnx"),
        "max_image_bytes": 1,
        "max_image_pixels": 2,
        "max_weights_bytes": 3,
        "store_dtype": "float16",
        "max_points": 4,
        "max_queued_images": 6,
        "max_points_in_flight": 7,
        "max_upload_bytes": 8,
        "max_answer_bytes": 9,
        "client_timeout_s": 9.5,
        "threads": 5,
        "workers": 6,
        "api_keys_file": Path("keys"),
        "metrics": "key",
        "rate_limit": "7/minute",
        "cors_origins": "https://a.example,http://b.example:8000",
        "embed_origins": "https://a.example",
        "allowed_hosts": "a.example,b.example",
        "trusted_proxies": "10.0.0.0/8,::1",
        "root_path": "/a/b",
        "drain_s": 7.5,
        "shutdown_s": 8,
        "log_level": "error",
        "log_format": "text",
    }
    for name, value in values.items():
        monkeypatch.setenv(f"HOF_{name.upper()}", "m.onnx" if name == "model" else str(value))
    assert Settings().model_dump() == values


def test_settings_from_arguments_override_the_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOF_PORT", "9")
    assert Settings(port=10).port == 10


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("port", 70_000),
        ("max_points", 10_000_001),
        ("max_points", 0),
        ("threads", 0),
        ("model", " , "),
        ("log_level", "loud"),
        ("workers", 0),
        ("rate_limit", "many"),
        ("rate_limit", "0/minute"),
        ("cors_origins", "https://a.example/"),
        ("cors_origins", "a.example"),
        ("embed_origins", "a.example"),
        ("embed_origins", "https://a.example;script-src"),
        ("allowed_hosts", "https://a.example"),
        ("allowed_hosts", "a.example:8080"),
        ("root_path", "a"),
        ("root_path", "/a/"),
        ("root_path", "//a"),
        *(("trusted_proxies", value) for value in ("*", "proxy", "10.0.0.0/33", "10.0.0.1/8", "")),
        ("hots", 1),
    ],
)
def test_settings_with_invalid_values_are_refused(name: str, value: object) -> None:
    with pytest.raises(ValidationError, match=name):
        Settings.model_validate({name: value})


@pytest.mark.parametrize(
    ("quota", "expected"), [("150000 100000\n", 2), ("1000 100000\n", 1), ("max 100000\n", 8), ("", 8)]
)
def test_available_cpus_with_a_quota_are_limited(monkeypatch: pytest.MonkeyPatch, quota: str, expected: int) -> None:
    monkeypatch.setattr("os.sched_getaffinity", lambda _: set(range(8)))
    monkeypatch.setattr(Path, "read_text", lambda *_: quota)
    assert available_cpus() == expected


@pytest.mark.parametrize(("quota", "expected"), [("150000", 2), ("-1", 8), ("800000", 8)])
def test_available_cpus_with_a_quota_of_cgroups_version_1_are_limited(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, quota: str, expected: int
) -> None:
    monkeypatch.setattr("os.sched_getaffinity", lambda _: set(range(8)))
    monkeypatch.setattr(module, "CGROUPS", tmp_path)
    (tmp_path / "cpu").mkdir()
    (tmp_path / "cpu" / "cpu.cfs_quota_us").write_text(f"{quota}\n")
    (tmp_path / "cpu" / "cpu.cfs_period_us").write_text("100000\n")
    assert available_cpus() == expected


def test_settings_beside_a_kubernetes_service_named_hof_keep_the_default_port(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOF_PORT", "tcp://10.0.0.1:80")
    assert Settings().port == 8080
