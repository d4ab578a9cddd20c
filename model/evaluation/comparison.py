"""Records of encoders, trained runs, ceilings and references on a split. Nothing is trained here."""

from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt
from torch import nn

from model.config import TrainConfig
from model.data.manifest import Split
from model.evaluation.conditions import Condition
from model.evaluation.evaluate import (
    PREDICTED_POINTS,
    Answer,
    Case,
    Evaluation,
    cases,
    draw,
    encoder_answer,
    measure,
    measure_objects,
)
from model.evaluation.records import Decoder, Record
from model.evaluation.references.ceiling import fit
from model.evaluation.references.methods import Retrieval, Training, matched_ellipsoid
from model.evaluation.references.shapes import TrainingShapes
from model.evaluation.timing import mapping_decoder, network_decoder
from model.metrics import compare, floor
from model.provenance import provenance
from model.training.checkpoints import chosen_checkpoint, load_network, predictor
from service.encoding.encoder import Encoder
from service.encoding.framing import preprocess
from service.encoding.masks import MattingFunction

Floats = npt.NDArray[np.float32]

COUNTS: Final = (1_000, 10_000, 100_000)  # predicted points, always against all 10,000 true ones
MEAN_SHAPE: Final = "mean shape"
RANDOM_SHAPE: Final = "random training shape"
RETRIEVAL: Final = "image retrieval"
ORACLE: Final = "oracle nearest neighbor"
ORACLE_OF_ALL: Final = "oracle among all training shapes"
ELLIPSOID: Final = "moment-matched ellipsoid (oracle)"
SAMPLING_FLOOR: Final = "sampling floor"
CEILING: Final = "theta fitted to the object"


def encoder_record(
    encoder: Encoder,
    data: Path,
    split: Split,
    seed: int,
    conditions: tuple[Condition, ...] = ("plain",),
    counts: tuple[int, ...] = (PREDICTED_POINTS,),
    matting: MattingFunction | None = None,
) -> Record:
    """Measure an exported encoder on a split; `counts` of points apply to plain images only.

    Raises
    ------
    FileNotFoundError : no data set, or a condition's images are not rendered.
    """
    objects, answer = list(cases(data, split)), encoder_answer(encoder, matting)
    evaluations = [
        evaluation
        for condition in conditions
        for evaluation in measure(
            encoder.name,
            answer,
            objects,
            data,
            condition,
            counts if condition == "plain" else (PREDICTED_POINTS,),
            seed,
        )
    ]
    origin = {"digest": encoder.digest, "training": encoder.card.get("training", {}), **provenance(seed)}
    return _record(encoder.name, split, objects, evaluations, origin, mapping_decoder(encoder))


def run_record(
    run: Path, name: str, data: Path, split: Split, seed: int, conditions: tuple[Condition, ...] = ("plain",)
) -> Record:
    """Measure a trained network of any method, not exported, on a split.

    Raises
    ------
    FileNotFoundError : no data set, no checkpoint, or a condition's images are not rendered.
    """
    network, config, state = load_network(chosen_checkpoint(run))
    answer = network_answer(run, network, config, seed)
    objects = list(cases(data, split))
    training = {"steps": state["step"], "minutes": round(state["elapsed_s"] / 60, 1), "config": config.to_dict()}
    origin = {"training": training, **provenance(config.seed)}
    evaluations = [measure(name, answer, objects, data, condition, seed=seed)[0] for condition in conditions]
    return _record(name, split, objects, evaluations, origin, network_decoder(network, config))


def network_answer(run: Path, network: nn.Module, config: TrainConfig, seed: int = 0) -> Answer:
    """Return a function that answers as a run's network, of any method, does.

    Raises
    ------
    ValueError : the network answers in the camera's frame, which the true points are not in.
    """
    if config.frame == "camera":
        raise ValueError(f"{run} was trained with --frame camera: `hof-model paper frame` measures such runs")
    predict = predictor(network, config)

    def answer(photo: bytes, n: int) -> Floats:
        points: Floats = predict(preprocess(photo, config.framing).tensor, n, seed)[0]
        return points

    return answer


def ceiling_record(encoder: Encoder, data: Path, split: Split, seed: int) -> Record:
    """Measure theta fitted directly to the points of each object of a split, with the encoder's spec."""
    spec, objects = encoder.spec, list(cases(data, split))
    thetas = fit(spec, np.stack([case.points for case in objects]), seed=seed)
    fitted = {case.entry.id: theta for case, theta in zip(objects, thetas, strict=True)}
    name = f"{CEILING} ({spec.name}, k = {spec.k})"
    evaluation = measure_objects(name, lambda case: compare(draw(spec, fitted[case.entry.id]), case.points), objects)
    return _record(name, split, objects, [evaluation], provenance(seed), None)


def references(
    data: Path,
    split: Split,
    seed: int,
    conditions: tuple[Condition, ...] = ("plain",),
    matting: MattingFunction | None = None,
) -> list[Evaluation]:
    """Measure the references, which need no training; image retrieval under every condition."""
    objects, training = list(cases(data, split)), Training.read(data)
    pool, retrieval = training.mean_shape(PREDICTED_POINTS, seed), Retrieval(data, training, matting)
    shapes: dict[str, Callable[[Case], Floats]] = {
        MEAN_SHAPE: lambda _: pool,
        RANDOM_SHAPE: lambda case: training.random_shape(case.entry.id, seed),
        ORACLE: lambda case: training.oracle(case.points),
        ELLIPSOID: lambda case: matched_ellipsoid(case.points, seed),
    }
    return [
        *(measure(RETRIEVAL, retrieval, objects, data, condition, seed=seed)[0] for condition in conditions),
        *(_shape(name, shape, objects) for name, shape in shapes.items()),
        measure_objects(SAMPLING_FLOOR, lambda case: floor(case.points), objects),
    ]


def oracle_of_all(data: Path, split: Split) -> Evaluation:
    """Measure the oracle among all shapes that the data set has for training."""
    shapes = TrainingShapes.read(data)
    name = f"{ORACLE_OF_ALL} ({len(shapes.files):,})"
    return _shape(name, lambda case: shapes.oracle(case.points), list(cases(data, split)))


def _shape(name: str, shape: Callable[[Case], Floats], objects: list[Case]) -> Evaluation:
    return measure_objects(name, lambda case: compare(shape(case), case.points), objects)


def _record(
    name: str,
    split: Split,
    objects: list[Case],
    evaluations: list[Evaluation],
    origin: dict[str, Any],
    decoder: Decoder | None,
) -> Record:
    return Record(name, split, decoder, origin, tuple(case.entry.id for case in objects), tuple(evaluations))
