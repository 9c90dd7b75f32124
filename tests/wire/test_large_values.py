"""Values with large arrays: encoded without a copy, read as views, and safe against damage."""

import pickle
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from tca_wire.errors import BadData
from tca_wire.messages.declarations import Command, Failure, Inform, Query, Retry, Variable
from tca_wire.messages.formats import Format, decode_untyped
from tca_wire.messages.large_data import LargeData, OpenedBody, copy_of, inline
from tca_wire.packets.large import (
    ALIGNMENT,
    LARGE,
    Handle,
    Keep,
    is_large,
    pack_handle,
    unpack_handle,
)
from tca_wire.text.bodies import data_text, plain_data
from tca_wire.vocabulary import Limit

ANY = Format[Any](Any)
BYTES = Format[bytes](bytes)


@dataclass
class Scan:
    name: str
    depth: NDArray[np.float32]
    marks: list[NDArray[np.uint8]]
    raw: bytes = b""


SCAN = Format[Scan](Scan)


def large_array(size: int = LARGE, dtype: Any = np.uint8) -> NDArray[Any]:
    count = -(-size // np.dtype(dtype).itemsize)
    return np.resize(np.arange(251, dtype=np.uint8), count * np.dtype(dtype).itemsize).view(dtype)


def encoded(value: Any, values: Format[Any] = ANY) -> LargeData:
    body = values.encode(value)
    assert isinstance(body, LargeData)
    return body


def opened(data: LargeData) -> OpenedBody:
    """Return the body as a receiver has it, with a segment in plain memory."""
    segment = bytearray(data.size)
    data.write(memoryview(segment))
    body = OpenedBody(data.body("ab/7"))
    body.content = memoryview(segment).toreadonly()
    return body


arrays = st.builds(
    lambda size, dtype, order: np.asarray(large_array(2 * size, dtype).reshape(2, -1), order=order),
    st.sampled_from([16, LARGE // 2 - 64, LARGE // 2, LARGE, 3 * LARGE]),
    st.sampled_from(["u1", "<f4", ">i8", "<M8[ns]", "S16", "<c8"]),
    st.sampled_from(["C", "F"]),
)


@given(marks=st.lists(arrays, max_size=5), raw=st.sampled_from([b"", b"raw", bytes(2 * LARGE)]))
def test_value_survives_in_each_form(marks: list[NDArray[Any]], raw: bytes) -> None:
    value = {"marks": marks, "raw": raw}
    body = ANY.encode(value)
    forms = [body, inline(body)] + ([opened(body)] if isinstance(body, LargeData) else [])
    assert isinstance(body, LargeData) == (len(inline(body)) > LARGE)
    for form in forms:
        got: Any = ANY.decode(form)
        assert got["raw"] == raw
        for sent, received in zip(marks, got["marks"], strict=True):
            assert received.dtype == sent.dtype
            assert received.shape == sent.shape
            assert received.tobytes() == sent.tobytes()


def test_large_array_is_not_copied() -> None:
    scan = Scan("front", large_array(4 * LARGE, np.float32), [large_array()])
    body = encoded(scan, SCAN)
    sent = [np.frombuffer(part, np.uint8) for part in body.parts]
    assert np.shares_memory(sent[0], scan.depth)
    assert np.shares_memory(sent[1], scan.marks[0])
    stored = opened(body)
    got = SCAN.decode(stored)
    assert np.shares_memory(got.depth, np.frombuffer(stored.content or b"", np.uint8))


@pytest.mark.parametrize("size", [LARGE, LARGE + 1, 3 * LARGE])
def test_large_bytes_are_not_copied(size: int) -> None:
    value = b"\x05" * size
    body = encoded(value, BYTES)
    assert any(part.obj is value for part in body.parts)
    assert {BYTES.decode(body), BYTES.decode(inline(body)), ANY.decode(opened(body))} == {value}


def test_body_with_large_data_is_short() -> None:
    values = [large_array(), [large_array(), [large_array(100)] * 2000], bytes(LARGE), "x" * LARGE]
    assert all(len(encoded(value).body("ab/7")) < 200 for value in values)


def test_data_below_the_bound_stay_in_the_body() -> None:
    assert not is_large(ANY.encode(large_array(LARGE - 100)))
    assert not is_large(Format[bytes](bytes).encode(bytes(LARGE - 100)))


@given(st.lists(st.integers(LARGE, 2 * LARGE), min_size=1, max_size=4))
def test_parts_are_aligned(sizes: list[int]) -> None:
    stored = opened(encoded([large_array(size) for size in sizes]))
    memory = np.frombuffer(stored.content or b"", np.uint8)
    start = memory.__array_interface__["data"][0]
    for array in ANY.decode(stored):
        assert (array.__array_interface__["data"][0] - start) % ALIGNMENT == 0


@pytest.mark.parametrize("size", [16, LARGE])
@pytest.mark.parametrize("kind", [np.memmap, np.matrix, np.recarray])
def test_array_of_a_subclass_arrives_as_a_plain_one(
    kind: type[NDArray[Any]], size: int, tmp_path: Path
) -> None:
    sent = large_array(size).reshape(4, -1).view(kind)
    if kind is np.memmap:
        np.save(tmp_path / "map.npy", sent)
        sent = np.load(tmp_path / "map.npy", mmap_mode="r")
    got = ANY.decode(inline(ANY.encode(sent)))
    assert (type(got), got.shape, got.tobytes()) == (np.ndarray, sent.shape, sent.tobytes())
    assert SCAN.decode(SCAN.encode(Scan("", large_array(dtype="f4"), [sent]))).marks[0].any()


@pytest.mark.parametrize("size", [10, LARGE])
def test_array_arrives_read_only(size: int) -> None:
    for form in (inline(ANY.encode(large_array(size))), ANY.encode(large_array(size))):
        array = ANY.decode(form)
        if not isinstance(form, LargeData):  # whose memory is the sender's
            with pytest.raises(ValueError, match="read-only"):
                array[0] = 1
        array.copy()[0] = 1


def test_misfit_of_large_data_names_the_field() -> None:
    with pytest.raises(BadData, match="Expected an array of `float32`"):
        SCAN.encode(Scan("front", large_array(dtype=np.float64), []))
    with pytest.raises(BadData, match=r"no place for `\$\.more`"):
        SCAN.encode({"name": "", "depth": large_array(dtype="f4"), "marks": [], "more": 1})  # type: ignore[arg-type]
    assert not is_large(ANY.encode(1)), "parts of a refused value are forgotten"


def test_failed_encoding_forgets_its_parts() -> None:
    with pytest.raises(BadData, match="can't be sent"):
        ANY.encode([large_array(), object()])
    assert ANY.encode(1) == b"\x01"


def test_data_beyond_the_limits_are_refused() -> None:
    half = np.broadcast_to(np.uint8(0), Limit.LARGE - 1)
    with pytest.raises(BadData, match=rf"at most {Limit.LARGE:d}; send a reference"):
        ANY.encode([large_array(), half])
    with pytest.raises(BadData, match=rf"at most {Limit.BODY:d}; send a reference"):
        inline(ANY.encode(large_array(Limit.BODY)))


def test_large_data_of_tasks_and_variables_are_kept() -> None:
    array = large_array()
    lift = Command("lift", np.ndarray, result=np.ndarray, progress=np.ndarray)
    logged = Command("lift", np.ndarray, result=np.ndarray, progress=np.ndarray, journal=True)
    image = Inform("image", np.ndarray, journal=True)
    variable = Variable("map", np.ndarray)
    kept = [
        unpack_handle(opened(body))[0].keep  # type: ignore[arg-type]
        for body in (
            lift.encode_data(array),
            lift.encode_reply(array),
            logged.encode_data(array),
            logged.encode_progress(array),
            image.encode_data(array),
            variable.encode_data(array),
        )
    ]
    both = Keep.TASK | Keep.JOURNAL
    assert kept == [Keep.TASK, 0, both, Keep.JOURNAL, Keep.JOURNAL, Keep.TASK]


def test_failure_and_fallback_hold_their_large_data() -> None:
    array = large_array()
    slipped, call = Failure("slipped", np.ndarray), Command("call", np.ndarray)
    raised = slipped(array)
    retry = Retry(otherwise=(call, array))
    array[0] = 99  # after the encoding
    copied = pickle.loads(pickle.dumps(raised))
    policy = retry.policy_for(Command("lift"))
    for body in (raised.body, copied.body, policy.data):
        assert ANY.decode(body)[0] == 0
    with pytest.raises(BadData, match="failure 'slipped' wants data of type"):
        slipped(large_array(Limit.BODY))


def test_large_body_is_pickled_with_its_data() -> None:
    value = large_array()
    for body in (encoded(value), opened(encoded(value))):
        assert np.array_equal(ANY.decode(pickle.loads(pickle.dumps(body))), value)
    with pytest.raises(BadData, match="has not opened"):
        ANY.decode(pickle.loads(pickle.dumps(OpenedBody(encoded(value).body("ab/7")))))


def test_unreadable_data_are_not_called_a_misfit() -> None:
    look = Query("look", NDArray[np.uint8], reply=NDArray[np.uint8])
    body = OpenedBody(encoded(large_array()).body("ab/7"))
    body.problem = "the data are gone"
    with pytest.raises(BadData, match=r"^query 'look': the data are gone$"):
        look.decode_data(body)
    with pytest.raises(BadData, match=r"^the answer to query 'look': the data are gone$"):
        look.decode_reply(body)
    with pytest.raises(BadData, match="came with data that is not of type"):
        look.decode_data(inline(encoded(large_array(dtype="f4"))))


def test_passed_on_data_are_the_same() -> None:
    scan = Scan("front", large_array(dtype=np.float32), [large_array()], bytes(LARGE))
    again = copy_of(opened(encoded(scan, SCAN)))
    got = SCAN.decode(opened(again))
    assert np.array_equal(got.marks[0], scan.marks[0])
    assert got.raw == scan.raw


def test_tools_describe_large_data_that_they_lack() -> None:
    image = large_array().reshape(4, -1, 16)
    body = encoded({"at": 1, "image": image}).body("ab/7")
    described = {"dtype": "|u1", "shape": list(image.shape), "bytes": image.nbytes}
    assert decode_untyped(body) == plain_data(body) == {"at": 1, "image": described}
    assert data_text(body) == '{"at": 1, "image": "uint8 array of 4 x 1024 x 16 (64 KiB)"}'
    whole = encoded(bytes(LARGE)).body("ab/7")
    assert (plain_data(whole), data_text(whole)) == ({"bytes": LARGE + 5}, '"data of 64 KiB"')
    assert plain_data(inline(encoded(image))) == described


# --- damage ---------------------------------------------------------------------------------------


def reference(code: int, *content: Any) -> bytes:
    return msgspec.msgpack.encode(msgspec.msgpack.Ext(code, msgspec.msgpack.encode(content)))


def lying(data: bytes, size: int = 1000) -> bytes:
    return pack_handle(Handle("", size, 0, data)) + bytes(size)


@pytest.mark.parametrize(
    "data",
    [
        reference(2, "|u1", [1000], 1, 1000),
        reference(2, "|u1", [8], -8, 8),
        reference(2, "|u1", [8], 0, -8),
        reference(2, "|u1", [8], 1 << 63, 8),
        reference(2, "<f4", [8], 0, 9),
        reference(2, "|u1", [9], 0, 8),
        reference(2, "|u1", [2, -4], 0, 9),
        reference(2, "|O", [1], 0, 8),
        reference(2, "|u1", [8], 0),
        reference(2, "nonsense", [8], 0, 8),
        reference(3, 0, 1001),
        reference(3, -1, 5),
        reference(3, 0),
        reference(3, "a", "b"),
        reference(2)[:-1],
        b"\xc1",
        b"",
    ],
    ids=repr,
)
def test_damaged_reference_is_refused(data: bytes) -> None:
    with pytest.raises(BadData):
        Format[Any](np.ndarray).decode(lying(data))
    plain_data(lying(data))


@given(st.integers(0, 200), st.integers(0, 255), st.booleans())
def test_damaged_body_is_refused_or_read_safely(at: int, byte: int, is_cut: bool) -> None:
    whole = bytearray(inline(encoded(Scan("front", large_array(dtype="f4"), [large_array()]))))
    at = min(at, len(whole) - 1)
    whole[at] = byte
    body = bytes(whole[:at]) if is_cut else bytes(whole)
    with suppress(BadData):
        SCAN.decode(body)
    assert data_text(body).isprintable()


@pytest.mark.parametrize("name", ["../../etc/passwd", "ab", "ab/7.free", "AB/7", "ab/-7", "/7"])
def test_handle_with_a_strange_name_is_refused(name: str) -> None:
    with pytest.raises(BadData, match="a large body is damaged"):
        ANY.decode(pack_handle(Handle(name, 1000, 0, b"\xc0")))


def test_encoded_values_are_compared_by_their_data() -> None:
    first, same, other = (encoded(large_array(size)) for size in (LARGE, LARGE, LARGE + 1))
    changed = large_array()
    changed[5] = 0
    assert first == same
    assert first != other
    assert first != encoded(changed)
    assert hash(first) == hash(same)
