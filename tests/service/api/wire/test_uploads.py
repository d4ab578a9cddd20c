"""Forms: the field `image`, whatever its bytes are."""

import pytest

from service.api.wire.uploads import MAX_DELIMITERS, MAX_PADDING, parse_form
from service.errors import InvalidInput

HEAD = b'--x\r\nContent-Disposition: form-data; name="image"; filename="a"\r\n\r\n'
END = b"\r\n--x--\r\n"
NEAR = b"\r\n--xA"  # the boundary, followed by what makes it data


@pytest.mark.parametrize("data", [b"", b"abc", b"\r\n", b"\r\n--", b"--x--\r\n", NEAR * (MAX_DELIMITERS - 1)])
def test_parse_form_with_any_data_returns_it(data: bytes) -> None:
    assert parse_form(HEAD + data + END, b"x").images == (data,)


@pytest.mark.parametrize("end", [END, b"\r\n--x" + b" " * MAX_PADDING + b"\r\n"])
def test_parse_form_with_spaces_after_the_boundary_follows_the_parser(end: bytes) -> None:
    body = HEAD + b"abc" + end
    if end == END:
        assert parse_form(body, b"x").images == (b"abc",)
    else:  # another field begins, and the form ends
        with pytest.raises(InvalidInput, match="last boundary is missing"):
            parse_form(body, b"x")


@pytest.mark.parametrize("near", [NEAR, b"\r\n--x-A", b"\r\n--x\rA", b"\r\n--x"])
def test_parse_form_with_too_many_boundaries_raises_invalid_input(near: bytes) -> None:
    with pytest.raises(InvalidInput, match=f"boundary more than {MAX_DELIMITERS} times, the limit: send the fields"):
        parse_form(HEAD + near * MAX_DELIMITERS + END, b"x")


@pytest.mark.parametrize("padding", [b" ", b"\t"])
def test_parse_form_with_too_many_spaces_after_a_boundary_raises_invalid_input(padding: bytes) -> None:
    with pytest.raises(InvalidInput, match=f"more than {MAX_PADDING} spaces after a boundary"):
        parse_form(HEAD + b"abc\r\n--x" + padding * (MAX_PADDING + 1) + b"\r\n" + END, b"x")
