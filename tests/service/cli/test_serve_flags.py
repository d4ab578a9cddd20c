"""`hof serve`: each setting has a flag, and its help tells the variable and the default."""

from functools import partial
from pathlib import Path

import pytest

from service.api.keys import make_key
from service.cli.main import main
from service.server.process import Server
from service.settings import SHIPPED_MATTING, Settings
from tests.support.small import model as tiny_model


def _values_of_all_settings(model_path: Path, folder: Path) -> dict[str, object]:
    """Return a value for each setting."""
    return {
        "host": "::1",
        "port": 1,
        "database_url": f"sqlite:///{folder / 'x.db'}",
        "model": (model_path, tiny_model.build(folder / "b.onnx", meta=tiny_model.metadata(name="b"))),
        "matting_model": SHIPPED_MATTING,
        "database_connections": 3,
        "database_timeout_s": 2.5,
        "root_path": "/hof",
        "allowed_hosts": "a.example",
        "trusted_proxies": "10.0.0.1",
        "max_image_bytes": 2,
        "max_image_pixels": 3,
        "max_weights_bytes": 4,
        "store_dtype": "float16",
        "max_points": 5,
        "threads": 6,
        "max_queued_images": 9,
        "max_points_in_flight": 10,
        "max_upload_bytes": 11,
        "max_answer_bytes": 12,
        "client_timeout_s": 12,
        "drain_s": 7,
        "shutdown_s": 8,
        "workers": 1,
        "api_keys_file": folder / "keys",
        "metrics": "key",
        "rate_limit": "8/minute",
        "cors_origins": "https://a.example",
        "embed_origins": "https://a.example",
        "log_level": "debug",
        "log_format": "text",
    }


def test_serve_with_all_flags_sets_every_setting(
    monkeypatch: pytest.MonkeyPatch, model_path: Path, tmp_path: Path
) -> None:
    values = _values_of_all_settings(model_path, tmp_path)
    (tmp_path / "keys").write_text(make_key("a", frozenset({"read"}))[1].line)
    assert values.keys() == Settings.model_fields.keys()
    passed: list[Settings] = []
    monkeypatch.setattr("service.api.app.create_app", lambda settings, _: passed.append(settings))

    def run(stopped: Server) -> None:
        assert isinstance(stopped.config.app, partial)
        stopped.config.app()
        stopped.started = True

    monkeypatch.setattr(Server, "run", run)
    pairs = [(name, one) for name, value in values.items() for one in (value if isinstance(value, tuple) else [value])]
    flags = [part for name, value in pairs for part in (f"--{name.replace('_', '-')}", str(value))]
    assert main(["serve", *flags]) == 0
    assert passed[0].model_dump() == values


def test_serve_help_shows_flags_variables_and_defaults(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit, match="0"):
        main(["serve", "--help"])
    text = " ".join(capsys.readouterr().out.split())
    assert "--max-image-bytes" in text
    assert "default: 20971520 [HOF_MAX_IMAGE_BYTES]" in text


@pytest.mark.parametrize(
    ("arguments", "variables", "message"),
    [
        (["--port", "99999"], {}, "HOF_PORT or --port: Input should be less than or equal to 65535, not '99999'"),
        (
            [],
            {"HOF_STORE_DTYPE": "int8"},
            "HOF_STORE_DTYPE or --store-dtype: Input should be 'float32' or 'float16', not 'int8'",
        ),
        (
            ["--rate-limit", "x"],
            {},
            "HOF_RATE_LIMIT or --rate-limit: 'x' is not a rate; examples: 100/minute, 10/second\n",
        ),
    ],
)
def test_serve_with_a_wrong_setting_names_flag_variable_limit_and_value(
    arguments: list[str],
    variables: dict[str, str],
    message: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    for name, value in variables.items():
        monkeypatch.setenv(name, value)
    assert main(["serve", *arguments]) == 2
    assert message in capsys.readouterr().err


def test_serve_with_an_abbreviated_flag_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["serve", "--store", "float16"])  # not --store-dtype
    assert "unrecognized arguments: --store float16" in capsys.readouterr().err
