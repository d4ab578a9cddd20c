"""The state of a run: the checkpoint that is chosen, and runs that start from another one."""

from dataclasses import replace
from pathlib import Path

import pytest
import torch

from model.config import EncoderConfig
from model.training.checkpoints import chosen_checkpoint, load_encoder, load_network
from model.training.state import RunState
from model.training.train import train
from tests.support.small.runs import RUN, records


def test_chosen_checkpoint_is_the_best_and_holds_the_average(run: Path, tmp_path: Path) -> None:
    validated = [record for record in records(run) if "f@1%" in record]
    assert validated
    assert all(0 <= record["f@1%"] <= record["f@2%"] <= 1 and record["val"] > 0 for record in validated)
    assert chosen_checkpoint(run) == run / "best.pt"
    saved = torch.load(run / "best.pt", weights_only=True)
    assert saved["best"] == max(record["f@1%"] + record["f@2%"] for record in validated)
    encoder, _, _ = load_encoder(run / "best.pt")
    assert torch.equal(encoder.head.linear.weight, saved["average"]["encoder.head.linear.weight"])
    assert not torch.equal(encoder.head.linear.weight, saved["network"]["encoder.head.linear.weight"])
    assert chosen_checkpoint(tmp_path) == tmp_path / "last.pt"


def test_save_of_a_worse_score_keeps_the_best(tmp_path: Path) -> None:
    state = RunState(RUN)
    for step, score in ((1, 0.3), (2, 0.2), (3, 0.4), (4, 0.1)):
        state.step = step
        state.save(tmp_path, score)
    assert torch.load(tmp_path / "best.pt", weights_only=True)["step"] == 3
    assert torch.load(tmp_path / "last.pt", weights_only=True)["step"] == 4


def test_train_from_a_checkpoint_takes_its_weights_and_counts_its_steps(run: Path, built: Path, tmp_path: Path) -> None:
    old = run / "last.pt"
    encoder, config, before = load_encoder(old)
    assert config == RUN
    again = replace(RUN, start=str(old), learning_rate=0.0, weight_decay=0.0, steps=3)
    train(built, tmp_path / "run", again)
    started, config, spent = load_encoder(tmp_path / "run" / "last.pt")
    assert config.start == str(old)
    assert spent["step"] == before["step"] + records(tmp_path / "run")[-1]["step"]
    assert spent["elapsed_s"] > before["elapsed_s"]
    assert torch.equal(started.head.linear.weight, encoder.head.linear.weight)  # a learning rate of 0


@pytest.mark.parametrize(
    ("problem", "change"),
    [
        ("rank", {"encoder": EncoderConfig(rank=4)}),
        ("method", {"method": "direct"}),
        ("trunk and another spec", {"encoder": replace(RUN.encoder, trunk="lite0"), "spec": RUN.spec.with_k(1)}),
    ],
)
def test_train_from_another_kind_of_network_is_refused(
    problem: str, change: dict[str, object], run: Path, built: Path, tmp_path: Path
) -> None:
    other = replace(RUN, start=str(run / "last.pt"), **change)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match=f"another {problem}"):
        train(built, tmp_path / "run", other)


def test_train_from_a_file_that_is_no_checkpoint_is_refused(built: Path, tmp_path: Path) -> None:
    (tmp_path / "photo.pt").write_bytes(b"no checkpoint")
    torch.save({"config": RUN.to_dict()}, tmp_path / "part.pt")
    for name in ("photo.pt", "part.pt"):
        with pytest.raises(ValueError, match=f"{name} is no checkpoint of `hof-model train`"):
            train(built, tmp_path / "run", replace(RUN, start=str(tmp_path / name)))


@pytest.mark.parametrize("frozen", [RUN.encoder.frozen, RUN.encoder.frozen + 1])
def test_begin_with_another_spec_takes_the_trunk(run: Path, frozen: int) -> None:
    encoder = replace(RUN.encoder, frozen=frozen)
    config = replace(RUN, spec=RUN.spec.with_k(1), encoder=encoder, start=str(run / "last.pt"))
    weights = RunState.begin(config).network.state_dict()
    for name, value in load_network(run / "last.pt")[0].state_dict().items():
        assert torch.equal(weights[name], value) != (".head.linear." in name), name
