"""Labels: one rule for forms, commands, files and stores."""

import json

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from safetensors import numpy as safetensors_numpy

from service.errors import CorruptWeights, InvalidParameter
from service.formats.weights import Weights, dump, load
from service.labels import MAX_LABEL, clean_label
from service.mapping.spec import MappingSpec

TINY = MappingSpec("tiny", 3, (2,), 3, k=2)
THETA = np.zeros(TINY.size, np.float32)


@given(st.text(st.characters(categories=["L", "M", "N", "P", "S", "Z", "Cf", "Cn", "Co"]), max_size=MAX_LABEL + 1))
@example("👩\u200d🚀")
@example("\u200e\ufeff")
@example(" \u00a0 ")
@example("\uffff\U0010ffff")
@example("🪑" * MAX_LABEL)
def test_every_label_that_is_accepted_comes_back_from_a_file(text: str) -> None:
    try:
        label = clean_label(text)
    except InvalidParameter:
        assert len(text) > MAX_LABEL or "\u2028" in text or "\u2029" in text
        return
    file = dump(Weights(TINY, THETA, "m", label=label), "safetensors")
    assert load(file).label == label
    assert json.loads(dump(Weights(TINY, THETA, "m", label=label), "json")).get("label") == label
    assert clean_label(label or "") == label
    (label or "").encode()  # a database can hold it


@pytest.mark.parametrize("text", ["x" * 81, "a\nb", "a\u2028b", "\0", "\x7f", "\x85", "\ud83e", "a\udcffb"])
def test_label_that_nothing_may_have_is_refused_everywhere(text: str) -> None:
    with pytest.raises(InvalidParameter, match="the label"):
        clean_label(text)
    with pytest.raises(CorruptWeights, match='"label" in the metadata: the label'):
        load(dump(Weights(TINY, THETA, "m", label=text), "safetensors"))


def test_label_of_another_programs_file_loses_the_spaces_around_it() -> None:
    metadata = {"format": "hof-theta-1", "spec": TINY.to_json(), "model": "m", "label": "  stool "}
    assert load(safetensors_numpy.save({"theta": THETA}, metadata=metadata)).label == "stool"
    assert load(safetensors_numpy.save({"theta": THETA}, metadata=metadata | {"label": ""})).label is None
