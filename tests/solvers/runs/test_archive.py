"""Archives give back records bit for bit, and refuse files with other fields, shorter arrays and invalid headers."""

import io
import tracemalloc
import zipfile
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from enum import Enum
from types import SimpleNamespace
from typing import Annotated, ClassVar

import numpy as np
import pytest
from divided import Exchange, PartSpace

from skfem_stvk.errors import StvkError
from skfem_stvk.npz import Ids, Measured, Stored, Vector, Within
from skfem_stvk.results.complete_files import ForeignFile, content_of
from skfem_stvk.solvers.runs import archive
from skfem_stvk.solvers.runs.archive import STRICT, Store, checked_header, read_archive, write_archive
from skfem_stvk.space import Space
from skfem_stvk.system.signature import Signature


@pytest.mark.parametrize("version", [(1, 0), (2, 0)])
def test_an_array_that_declares_too_many_entries_takes_no_memory(tmp_path, version):
    path, known = tmp_path / "a.npz", ("test", 1)
    write_archive(path, {"format": "test", "version": 1}, {"x": np.ones(3)})
    assert read_archive(path, known, "")[1]["x"].tolist() == [1, 1, 1]
    member = io.BytesIO()
    np.lib.format.write_array(member, np.empty(0), version)
    few = member.getvalue().replace(b"(0,), }" + 12 * b" ", b"(1000000000000,), }")
    assert few != member.getvalue() and len(few) == len(member.getvalue())
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr("array y.npy", few)
    with pytest.raises(ForeignFile, match=r"array y.npy declares more numbers than there are") as caught:
        read_archive(path, known, "")
    assert not isinstance(caught.value.__cause__, MemoryError)


def test_a_flipped_bit_in_the_header_of_an_array_is_refused_in_words(tmp_path):
    """A damaged array header is refused in words, although NumPy then raises an error of Python's tokenizer.

    The checksum does not help, because it is compared at the end of an array.
    """
    path, known = tmp_path / "a.npz", ("test", 1)
    write_archive(path, {"format": "test", "version": 1}, {"x": np.ones(100_000)})
    before, _, after = path.read_bytes().rpartition(b"{'descr'")
    path.write_bytes(before + b"z'descr'" + after)
    with pytest.raises(ForeignFile, match=r"incomplete, or was not written by this package .*(TokenError|Cannot parse header)"):
        read_archive(path, known, "")


def divided_numbers(parts, seed):
    """Return the numbers of 40 degrees of freedom in each of some parts; neighbours share some of them."""
    rng = np.random.default_rng(seed)
    return [rng.permutation(np.union1d(own, rng.integers(0, 40, 3))) for own in np.array_split(rng.permutation(40), parts)]


@pytest.mark.few
@pytest.mark.parametrize(("before", "now"), [(3, 3), (3, 2), (2, 3), (5, 2), (3, 1), (1, 3)])
@pytest.mark.parametrize("damaged", [False, True])
def test_each_file_of_a_part_is_read_once_by_any_number_of_parts(before, now, damaged, tmp_path, monkeypatch):
    values, file, reads = np.cos(np.arange(80.0)).reshape(2, 40), tmp_path / "state.npz", []
    parts = [f"rank{rank:04d}_state.npz" for rank in range(before)]
    for name, numbers in zip(parts, old := divided_numbers(before, 1), strict=True):
        write_archive(tmp_path / name, {"format": archive.PART[0], "version": 1}, {"numbers": numbers, "u": values[:, numbers]})
    if damaged:
        (tmp_path / parts[-1]).write_bytes(b"")

    def counted(path, *arguments):
        reads.append(path.name)
        return read_archive(path, *arguments)

    monkeypatch.setattr(archive, "read_archive", counted)
    for new in (divided_numbers(now, 2), *([old] if before == now else [])):
        exchange, reads[:] = Exchange(now), []

        def read(part, new=new, exchange=exchange):
            numbers = new[part]
            space = PartSpace(exchange, part, 40, 1, numbers, (slice(0, len(numbers)),))
            try:
                return archive.of_parts(file, parts, space, "Start again.")
            except StvkError as error:
                return error

        with ThreadPoolExecutor(now) as pool:
            found = list(pool.map(read, range(now)))
        assert sorted(reads) == parts[: len(reads)] and (damaged or len(reads) == before)
        for numbers, arrays in zip(new, found, strict=True):
            if damaged:
                assert isinstance(arrays, StvkError) and parts[-1] in str(arrays)
            else:
                assert np.array_equal(arrays["u"], values[:, numbers]) and set(arrays) == {"u"}


def test_a_compressed_archive_is_refused(tmp_path):
    """A compressed archive is refused, because it may expand beyond the memory."""
    path = tmp_path / "a.npz"
    np.savez_compressed(path, header=np.array("{}"), digest=np.array(""), **{"array x": np.zeros(10_000)})
    with pytest.raises(ForeignFile, match=r"header.npy is compressed; expected arrays as np.savez writes them"):
        read_archive(path, ("test", 1), "")


def test_a_small_file_takes_little_memory_at_any_limit(tmp_path):
    path = tmp_path / "small.txt"
    path.write_bytes(b"12")
    tracemalloc.start()
    try:
        assert content_of(path, 2**40) == b"12"
        assert tracemalloc.get_traced_memory()[1] < 2**20
    finally:
        tracemalloc.stop()
    with pytest.raises(OSError, match="more than 1 bytes"):
        content_of(path, 1)


SIGNATURE = {"kind": "motion", "method": {}, "moments": [0.0], "numbers": {"the mesh": [1.0]}}


@pytest.mark.parametrize(
    "change, why",
    [
        ({"moments": 10 * [0.0]}, "expected at most 9 moments"),
        ({"numbers": {"the mesh": 10 * [1.0]}}, "9 numbers of each name"),
        ({"numbers": {"the mesh": [True]}}, "valid number"),
        ({"moments": [float("nan")]}, "finite number"),
        ({"kind": "picture"}, "'path of equilibria' or 'motion'"),
        ({"more": 1}, "Unexpected keyword"),
        ({"method": None}, "an object"),
    ],
)
def test_a_header_with_an_impossible_signature_is_refused_in_words(tmp_path, change, why):
    path, header = tmp_path / "a.npz", {"format": "test", "version": 1, "record": {}}
    assert asdict(checked_header(path, header | {"problem": SIGNATURE}, "").problem) == SIGNATURE
    with pytest.raises(ForeignFile, match=rf"a\.npz is damaged: problem.*{why}"):
        checked_header(path, header | {"problem": SIGNATURE | change}, "")


class Colour(Enum):
    RED = "red"
    BLUE = "blue"


@dataclass
class Part:
    x: float
    u: Vector
    ids: Ids


@dataclass
class Toy:
    """Record with each kind of field."""

    __pydantic_config__: ClassVar = STRICT

    count: Annotated[int, Within(0, 9)]
    ratio: Measured
    colour: Colour
    parts: tuple[Part, ...]
    best: Part | None
    named: dict[str, Ids]
    table: Annotated[np.ndarray, Stored(2, finite=False)]
    words: str = "as usual"


class ToyFile(Store[Toy]):
    known, remedy, schema = ("toy", 1), "Make it again.", Toy


class Renumbered(Space):
    numbers = np.array([2, 0, 1])


PROBLEM = SimpleNamespace(signature=Signature(**SIGNATURE))


def toy():
    parts = tuple(Part(1 / 3, np.array([i, 0.1, -0.0]), np.array([i, 7])) for i in range(2))
    return Toy(3, np.nan, Colour.BLUE, parts, parts[1], {"a b": np.arange(3)}, np.array([[np.nan, 1 / 3]]))


@pytest.mark.parametrize("space", [None, Space(3), Renumbered(3)])
def test_a_record_is_read_back_bit_for_bit_in_the_numbering_of_its_space(space, tmp_path):
    ToyFile.write_file(tmp_path / "toy.npz", PROBLEM, toy(), space)
    problem, again = ToyFile.read_file(tmp_path / "toy.npz", space)
    assert problem == PROBLEM.signature and repr(again) == repr(toy())
    assert again.best.u.tobytes() == toy().best.u.tobytes() and again.named["a b"].dtype == np.int64
    archive.check_lengths(again, 3)
    with pytest.raises(ValueError, match=r"the array 'parts 0 u' has shape \(3,\); expected a length of 4"):
        archive.check_lengths(again, 4)
    if space is not None:
        stored = read_archive(tmp_path / "toy.npz", ToyFile.known, "")[1]["best u"]
        np.testing.assert_array_equal(stored[space.numbers], toy().best.u)


@pytest.mark.parametrize(
    ("change", "why"),
    [
        ({"count": 10}, "count: Input should be less than or equal to 9"),
        ({"count": 1.5}, "count: Input should be a valid integer"),
        ({"colour": "green"}, "colour: Input should be 'red' or 'blue'"),
        ({"parts": None}, "parts: Input should be a valid array"),
        ({"best": {"x": float("nan"), "u": "best u", "ids": "best ids"}}, "best.x: Input should be a finite number"),
        ({"best": {"x": 0.0, "u": "best v", "ids": "best ids"}}, "best.u: it has no array 'best v'"),
        ({"best": {"x": 0.0, "u": "best ids", "ids": "best ids"}}, "best.u: the array 'best ids' is int64 of shape"),
        ({"best": {"x": 0.0, "u": "table", "ids": "best ids"}}, "best.u: the array 'table' is float64 of shape .* with 1 axes"),
        ({"more": 1}, "more: Unexpected keyword argument"),
        ({"words": 3}, "words: Input should be a valid string"),
        ({"words": ...}, "words: Field required"),
        ({"ratio": ...}, "ratio: Field required"),
        ({"colour": 0, "words": 0, "ratio": "", "parts": 0}, "; and 1 more"),
    ],
)
def test_a_record_with_a_field_of_another_type_is_refused_in_words(change, why, tmp_path):
    path = tmp_path / "toy.npz"
    ToyFile.write_file(path, PROBLEM, toy())
    header, arrays = read_archive(path, ToyFile.known, "")
    record = {name: value for name, value in (header["record"] | change).items() if value is not ...}
    write_archive(path, header | {"record": record}, arrays)
    with pytest.raises(ForeignFile, match=rf"toy\.npz is damaged: .*{why}.*\. Make it again\."):
        ToyFile.read_file(path)
