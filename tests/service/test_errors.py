"""Errors that name the file, or the part of the input, at fault."""

import pickle

from service.errors import InvalidParameter, RateLimited


def test_prefixed_error_keeps_its_kind_field_and_other_values() -> None:
    error = InvalidParameter("too large", field="n")
    named = error.prefixed("a.ply")
    assert type(named) is InvalidParameter
    assert (str(named), named.detail, named.field) == ("a.ply: too large", "a.ply: too large", "n")
    assert error.detail == "too large"
    assert RateLimited("slow down", retry_after_s=7).prefixed("x").retry_after_s == 7
    assert pickle.loads(pickle.dumps(named)).detail == "a.ply: too large"
