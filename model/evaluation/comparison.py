"""One run of all that is compared without training anything: our encoder, the references, the conditions."""

from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from model.data.manifest import Split
from model.evaluation.ceiling import fit
from model.evaluation.conditions import Condition
from model.evaluation.evaluate import POINTS, Case, Evaluation, cases, draw, encoder_answer, measure, measure_objects
from model.evaluation.records import Decoder, Record
from model.evaluation.references import Retrieval, Training, blob
from model.evaluation.timing import mapping_decoder, network_decoder
from model.metrics import compare, floor
from model.provenance import provenance
from model.training.checkpoints import chosen_checkpoint, load_network, predictor
from service.encoding.encoder import Encoder
from service.encoding.framing import preprocess

Floats = npt.NDArray[np.float32]

COUNTS: Final = (1_000, 10_000, 100_000)  # predicted points, always against all 10,000 true ones
MEAN_SHAPE: Final = "mean shape"
RANDOM_SHAPE: Final = "random training shape"
RETRIEVAL: Final = "image retrieval"
ORACLE: Final = "oracle nearest neighbour"
BLOB: Final = "blob that knows the truth"
FLOOR: Final = "same surface, sampled again"
CEILING: Final = "theta fitted to the object"


def encoder_record(
    encoder: Encoder,
    data: Path,
    split: Split,
    seed: int,
    conditions: tuple[Condition, ...] = ("plain",),
    counts: tuple[int, ...] = (POINTS,),
) -> Record:
    """An exported encoder on a split; the counts of points on plain images only.

    Raises
    ------
    FileNotFoundError : no data set, or a condition's images are not rendered.
    """
    objects, answer = list(cases(data, split)), encoder_answer(encoder)
    evaluations = [
        found
        for condition in conditions
        for found in measure(
            encoder.name, answer, objects, data, condition, counts if condition == "plain" else (POINTS,), seed
        )
    ]
    made = {"digest": encoder.digest, "training": encoder.card.get("training", {}), **provenance(seed)}
    return _record(encoder.name, split, objects, evaluations, made, mapping_decoder(encoder))


def run_record(
    run: Path, name: str, data: Path, split: Split, seed: int, conditions: tuple[Condition, ...] = ("plain",)
) -> Record:
    """A trained network of any method, not exported, on a split. Raises as `encoder_record`."""
    checkpoint = chosen_checkpoint(run)
    network, config, state = load_network(checkpoint)
    predict = predictor(network, config)

    def answer(photo: bytes, n: int) -> Floats:
        points: Floats = predict(preprocess(photo, config.framing).tensor, n, seed)[0]
        return points

    objects = list(cases(data, split))
    training = {"steps": state["step"], "minutes": round(state["elapsed_s"] / 60, 1), "config": config.to_dict()}
    made = {"training": training, **provenance(config.seed)}
    evaluations = [found for which in conditions for found in measure(name, answer, objects, data, which, seed=seed)]
    return _record(name, split, objects, evaluations, made, network_decoder(checkpoint))


def ceiling_record(encoder: Encoder, data: Path, split: Split, seed: int) -> Record:
    """theta fitted directly to the points of each object of a split, with the encoder's spec."""
    spec, objects = encoder.spec, list(cases(data, split))
    thetas = fit(spec, np.stack([case.points for case in objects]), seed=seed)
    fitted = {case.entry.id: theta for case, theta in zip(objects, thetas, strict=True)}
    name = f"{CEILING} ({spec.name}, k = {spec.k})"
    found = measure_objects(name, lambda case: compare(draw(spec, fitted[case.entry.id]), case.points), objects)
    return _record(name, split, objects, [found], provenance(seed), None)


def references(data: Path, split: Split, seed: int, conditions: tuple[Condition, ...] = ("plain",)) -> list[Evaluation]:
    """The answers that need no training; image retrieval under every condition."""
    objects, training = list(cases(data, split)), Training.read(data)
    pool, retrieval = training.mean_shape(POINTS, seed), Retrieval(data, training)
    shapes: dict[str, Callable[[Case], Floats]] = {
        MEAN_SHAPE: lambda _: pool,
        RANDOM_SHAPE: lambda case: training.random_shape(case.entry.id, seed),
        ORACLE: lambda case: training.oracle(case.points),
        BLOB: lambda case: blob(case.points, seed),
    }
    return [
        *(measure(RETRIEVAL, retrieval, objects, data, condition, seed=seed)[0] for condition in conditions),
        *(_shape(name, shape, objects) for name, shape in shapes.items()),
        measure_objects(FLOOR, lambda case: floor(case.points), objects),
    ]


def _shape(name: str, shape: Callable[[Case], Floats], objects: list[Case]) -> Evaluation:
    return measure_objects(name, lambda case: compare(shape(case), case.points), objects)


def _record(
    name: str,
    split: Split,
    objects: list[Case],
    evaluations: list[Evaluation],
    made: dict[str, Any],
    decoder: Decoder | None,
) -> Record:
    return Record(name, split, decoder, made, tuple(case.entry.id for case in objects), tuple(evaluations))
